"""Gaps of marker takes: filled better than by interpolation, without jumps, and written into the file they are of."""

import json
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.markers.filtering import smooth_on_body, smooth_take
from perfanim.core.markers.gap_filling import Gap, fill_gaps, find_gaps, widen_gaps
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.subjects.from_motion import frames_of
from scipy.interpolate import CubicSpline

NOISE_M, OFFSET_M = 0.0005, 0.005  # of the markers, and by how much the subject's calibration has their places wrong
GAPS = {"LFIN": (12, 30), "RKNE": (15, 45), "LTOE": (20, 32), "C7": (5, 35), "RELB": (8, 50), "RFWT": (25, 40)}


@pytest.fixture(scope="module")
def suited(truth):
    return Subject("walker", truth.skeleton, load_marker_set("cmu-41"))


@pytest.fixture(scope="module")
def whole(truth, suited):
    worn = suited.marker_set
    off = np.random.default_rng(5).normal(0.0, OFFSET_M, (len(worn), 3))
    return simulate_markers(truth, worn.with_offsets(worn.offsets_m + off), noise_mm=1e3 * NOISE_M)[0]


@pytest.fixture(scope="module")
def gappy(whole):
    positions = whole.positions_m.copy()
    for name, (start, stop) in GAPS.items():
        positions[start:stop, whole.names.index(name)] = np.nan
    return replace(whole, positions_m=positions)


@pytest.fixture(scope="module")
def filled(gappy, suited, database):
    motion = solve_take(widen_gaps(gappy), suited, database, SolveSettings(), lambda *_: None).motion
    return fill_gaps(gappy, suited.marker_set, motion)


def error_m(take: MarkerTake, whole: MarkerTake, gap: Gap) -> float:
    rows = slice(gap.start, gap.stop)
    return float(np.sqrt(np.mean((take.positions_m[rows, gap.marker] - whole.positions_m[rows, gap.marker]) ** 2)))


def test_gaps_are_found():
    visible = np.array([[1, 0, 0, 1, 0], [1, 1, 1, 1, 1], [0, 0, 0, 0, 0]], dtype=bool).T
    assert find_gaps(visible) == [Gap(0, 1, 3), Gap(0, 4, 5)]


def test_measured_positions_are_unchanged(gappy, filled):
    np.testing.assert_array_equal(filled.positions_m[gappy.visible], gappy.positions_m[gappy.visible])
    assert filled.visible.all()


def test_gaps_are_filled_better_than_by_interpolation(whole, gappy, filled):
    """Against lines and cubic splines through what is measured beside the gap: gaps of 0.4 s and more."""
    lines, splines = gappy.positions_m.copy(), gappy.positions_m.copy()
    rows = np.arange(gappy.frames)
    for gap in find_gaps(gappy.visible):
        path, seen = gappy.positions_m[:, gap.marker], gappy.visible[:, gap.marker]
        inside = slice(gap.start, gap.stop)
        splines[inside, gap.marker] = CubicSpline(rows[seen], path[seen])(rows[inside])
        for axis in range(3):
            lines[inside, gap.marker, axis] = np.interp(rows[inside], rows[seen], path[seen, axis])
    ours, straight, curved = (
        np.mean([error_m(take, whole, gap) for gap in find_gaps(gappy.visible)])
        for take in (filled, replace(gappy, positions_m=lines), replace(gappy, positions_m=splines))
    )
    assert ours < 0.5 * straight
    assert ours < 0.5 * curved
    assert ours < 2.0 * OFFSET_M


def test_filled_gaps_have_no_jumps(whole, gappy, filled):
    """The steps into a gap and out of it are the marker's own, but for noise and what the body leaves open."""
    for gap in find_gaps(gappy.visible):
        for row in (gap.start, gap.stop):
            steps = [
                take.positions_m[row, gap.marker] - take.positions_m[row - 1, gap.marker] for take in (filled, whole)
            ]
            assert np.linalg.norm(steps[0] - steps[1]) < OFFSET_M


def test_gap_at_the_end_of_a_take_is_filled_by_the_body(whole, suited, database):
    positions = whole.positions_m[:40].copy()
    positions[22:, whole.names.index("LWRA")] = np.nan
    take = replace(frames_of(whole, slice(0, 40)), positions_m=positions)
    motion = solve_take(widen_gaps(take), suited, database, SolveSettings(), lambda *_: None).motion
    result = fill_gaps(take, suited.marker_set, motion)
    assert error_m(result, whole, Gap(whole.names.index("LWRA"), 22, 40)) < 4.0 * OFFSET_M


@pytest.mark.long
def test_body_improves_the_low_pass(truth, suited, database):
    """Three millimetres of noise, and a low pass at what suits each: with the body's help less is left of it."""
    clean, noisy = (simulate_markers(truth, suited.marker_set, noise_mm=noise)[0] for noise in (0.0, 3.0))
    motion = solve_take(noisy, suited, database, SolveSettings(), lambda *_: None).motion

    def rms_m(take):
        return float(np.sqrt(np.mean((take.positions_m - clean.positions_m)[5:-5] ** 2)))

    alone = min(rms_m(smooth_take(noisy, hz)) for hz in (4.0, 5.0, 6.0, 8.0, 10.0))
    assert rms_m(smooth_on_body(noisy, suited.marker_set, motion, 8.0)) < alone < rms_m(noisy)


@pytest.mark.long
def test_filled_file_keeps_its_labels(whole, gappy, suited, database_file, tmp_path, capsys):
    """Labels with a subject before them, another point beside them, z up."""
    names = (*(f"Ben:{name}" for name in gappy.names), "ball")
    ball = np.where(np.arange(gappy.frames)[:, None, None] % 7 == 0, np.nan, [[[0.5, 1.0, 2.0]]])
    z_up = np.concatenate((gappy.positions_m, ball), axis=1)[..., [0, 2, 1]] * [1.0, -1.0, 1.0]
    write_take(MarkerTake("a", gappy.fps, names, z_up), tmp_path / "a.c3d")
    save_subject(suited, tmp_path / "ben.toml")
    line = ["take", "fill", tmp_path / "a.c3d", "--out", tmp_path / "b.c3d", "--database", database_file]
    assert main([*map(str, [*line, "--subject", tmp_path / "ben.toml"]), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["gaps"], told["filled"]) == (len(GAPS), sum(stop - start for start, stop in GAPS.values()))
    assert told["warnings"] == ["gaps remain in ball: these are not in the marker set, or are never visible"]
    before, after = (read_take(tmp_path / name) for name in ("a.c3d", "b.c3d"))
    assert (after.names, after.fps) == (names, before.fps)
    np.testing.assert_array_equal(after.positions_m[before.visible], before.positions_m[before.visible])
    world = after.positions_m[..., [0, 2, 1]] * [1.0, 1.0, -1.0]
    for gap in find_gaps(gappy.visible):
        assert error_m(replace(after, positions_m=world), whole, gap) < 4.0 * OFFSET_M
    write_take(MarkerTake("a", gappy.fps, names, z_up[:25]), tmp_path / "a.c3d")
    assert main([*map(str, [*line, "--subject", tmp_path / "ben.toml"]), "--filter", "10"]) == 0
    changed = ~(read_take(tmp_path / "b.c3d").positions_m == before.positions_m[:25]).all(axis=-1)
    assert changed[:, :-1].mean() > 0.99
    assert not changed[np.isfinite(ball[:25, 0, 0]), -1].any()
    assert main([*map(str, line[:2]), str(tmp_path / "a.c3d"), "--out", "b.xyz", *map(str, line[5:])]) == 1


@pytest.mark.long
def test_frozen_stretches_are_filled_unless_labels_are_trusted(whole, suited, database_file, tmp_path, capsys):
    held, stretch = whole.names.index("RFIN"), slice(20, 40)
    shown = frames_of(whole, slice(0, 45))
    positions = shown.positions_m.copy()
    positions[stretch, held] = positions[stretch.start, held]
    write_take(replace(shown, positions_m=positions), tmp_path / "a.trc")
    save_subject(suited, tmp_path / "ben.toml")
    line = ["take", "fill", tmp_path / "a.trc", "--out", tmp_path / "b.trc", "--database", database_file]
    line = [*map(str, [*line, "--subject", tmp_path / "ben.toml"]), "--json"]
    found = []
    for more in ([], ["--trust-labels"]):
        assert main([*line, *more]) == 0
        told = json.loads(capsys.readouterr().out)
        away_m = np.linalg.norm(read_take(tmp_path / "b.trc").positions_m - shown.positions_m, axis=-1)[stretch, held]
        found.append((told["gaps"], away_m.max() < 0.02, told["warnings"]))
    text = "RFIN stood still while the body moved, treated as missing (frames 21 to 39)"
    assert found == [(1, True, [text]), (0, False, [])]
