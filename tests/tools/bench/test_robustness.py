"""The benchmark of cuts, T poses and noise, on a few short takes."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from bench.end_to_end import film
from bench.films import film_row
from bench.noisy_takes import with_t_pose
from bench.robustness import Sizes, robustness, summary
from bench.run import Run
from bench.scenarios import FPS, WITHOUT_PRIOR
from bench.scenes import AFTER, BEFORE, crossings, facing, meetings, play_cut, play_pair, random_cuts, walk_outs
from bench.solving import MARKER_SET, true_subject
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.database.store import open_database
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry import rotations as rot
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import simulated_source
from perfanim.core.simulate.studio.stage_placement import on_stage, with_poses
from perfanim.core.simulate.studio.studio_rig import default_rig

TRIALS = {"16_15": "walking-01-neutral", "16_16": "walking-02-energetic", "09_01": "running-01-brisk"}


@pytest.fixture(scope="module")
def data(embedded_motion, tmp_path_factory):
    """Folder like that of the recordings: two subjects, one test take."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "cmu").mkdir()
    for trial, name in TRIALS.items():
        write_bvh(sliced(embedded_motion[name], 0, 42), folder / "cmu" / f"{trial}.bvh")
    return folder


def heading(motion):
    forward = rot.rotate(motion.rotations[0, 0], [0.0, 0.0, 1.0])
    return np.arctan2(forward[0], forward[2])


@pytest.mark.long
def test_robustness_writes_what_it_measures(data, tmp_path):
    sizes = Sizes(takes=2, cuts=2, t_pose_frames=4, noisy_frames=6, passes=2, films=0, absences=1)
    figures = robustness(Run(data, tmp_path, 1), sizes=sizes)
    assert {row["take"] for row in figures["t_pose"]} == {"09_01", "16_15"}
    assert [row["seed"] for row in figures["noise"]] == [0, 1, 0, 1]
    assert {clip.subject for clip in open_database(tmp_path / "databases/cmu-without-subject-16.pfdb").clips} == {"09"}
    assert len(figures["cuts"]) == 2
    assert figures["crossings"] == []  # the takes are too short
    assert [row["hidden_s"] >= 2.0 for row in figures["absences"]] == [True]  # and nobody walks out
    values = {row["check"]: row["value"] for row in figures["rows"]}
    assert values["4 noise: frames, sum"] == 24
    assert 0.0 < values["4 noise: deg_per_joint, mean"] < 60.0
    assert 0.0 <= values["4 noise: ghost_right_markers / ghost_shown_markers"] <= 1.0
    assert 0.0 < values["4 noise: part_errors_within_twice_expected, mean"] <= 1.0
    for frame in figures["worst"]:
        assert frame["frame"] >= 0
        assert frame["value"] == max(
            row["value"] for row in figures["worst"] if (row["check"], row["take"]) == (frame["check"], frame["take"])
        )
    jump = next(row for row in figures["worst"] if row["joint"])
    assert jump["check"].startswith("joint change")
    assert json.loads((tmp_path / "robustness.json").read_text())["rows"] == figures["rows"]
    with (tmp_path / "robustness-worst.csv").open() as stream:
        assert len(list(csv.DictReader(stream))) == len(figures["worst"])
    assert (tmp_path / "robustness-worst.svg").stat().st_size > 5_000
    assert (tmp_path / "robustness-worst-frames.png").stat().st_size > 5_000


@pytest.mark.long
def test_a_part_alone_has_the_figures_of_the_whole(data, tmp_path):
    sizes = Sizes(takes=2, cuts=1, t_pose_frames=4, noisy_frames=4, films=0, absences=1)
    parts = [("cuts",), ("cuts", "absences")]
    figures = [robustness(Run(data, tmp_path, 1), only=each, seed=8, sizes=sizes) for each in parts]
    assert figures[0]["cuts"] == figures[1]["cuts"]
    assert "noise" not in figures[0]
    assert json.loads((tmp_path / "robustness-cuts.json").read_text())["seed"] == 8


@pytest.mark.long
def test_a_film_of_a_known_walk_costs_little(embedded_motion, database_of, tmp_path):
    """The studio's own rig, so that images, stereo and labels alone are measured."""
    name = "walking-02-energetic"
    walk = on_stage(sliced(resampled(embedded_motion[name], FPS), 0, 40))
    source = simulated_source(with_poses(walk, ("t",), 0.1), MARKER_SET, Renderer(default_rig()))
    filmed, start = film(source, source.rig), source.frames - walk.frames
    others = [motion for other, motion in embedded_motion.items() if other != name]
    database = database_of(tmp_path / "others.pfdb", others)
    row = film_row(filmed, start, source.rig, database, WITHOUT_PRIOR)
    assert row["frames"] == len(filmed.frames) - start
    assert row["visible_marker_frames"] > 3 * row["frames"]
    assert row["right_share"] > 0.95
    assert row["cost_deg"] == pytest.approx(row["video_deg_per_joint"] - row["true_deg_per_joint"], abs=1e-3)
    assert abs(row["cost_share"]) < 0.5
    assert row["offline_other_frames"] == 0
    assert summary({"films": [row]})[0]["value"] == round(row["right_share"], 4)


def test_who_walks_out_of_the_pictures_comes_back_whole(embedded_motion):
    takes = {f"0{i}_01": resampled(motion, FPS) for i, motion in enumerate(list(embedded_motion.values())[:4])}
    walks = list(walk_outs(takes, 3, np.random.default_rng(0)))
    assert walks
    for walk in walks:
        seen = np.isfinite(walk.positions_m[..., 0])
        assert seen[0].all() and seen[walk.back].all()
        gone = seen[: walk.back].sum(axis=1)
        assert np.sum(gone == 0) >= 2.0 * FPS
        assert np.any((gone > 0) & (gone < seen.shape[1]))  # not all at once
        assert len(seen) == walk.back + AFTER


@pytest.fixture(scope="module")
def takes(embedded_motion):
    """Two takes, long enough for a cut."""
    names = ("walking-01-neutral", "running-02-neutral")
    motions = [replace(embedded_motion[name], fps=FPS) for name in names]
    return {f"0{i}_01": sliced(motion, 0, AFTER + 2) for i, motion in enumerate(motions)}


@pytest.mark.long
def test_a_body_known_to_the_database_is_named_after_the_cut(takes, database_of, tmp_path):
    database = database_of(tmp_path / "both.pfdb", list(takes.values()))
    generator = np.random.default_rng(1)
    for cut in random_cuts(takes, 2, generator):
        row, right, confidence = play_cut(cut, database, WITHOUT_PRIOR, generator)
        assert len(right) == len(confidence) == AFTER
        assert row["right_again_s"] <= 1.0
        assert row["wrong_frames"] == (~right).sum()
        assert row["right_markers"] < row["recorded_right_markers"] <= row["shown_markers"]


def test_two_who_pass_each_other_keep_their_labels(embedded_motion, database_of, tmp_path):
    names = ("walking-01-neutral", "walking-02-energetic")
    walks = {}
    for number, name in enumerate(names):
        walk = sliced(resampled(embedded_motion[name], FPS), 0, 150)
        forward = rot.rotate(walk.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
        gone = np.linspace(0.0, 2.5, walk.frames)[:, None] * forward
        walks[f"0{number}_01"] = replace(walk, root_positions_m=walk.root_positions_m + gone)
    database = database_of(tmp_path / "both.pfdb", list(walks.values()))
    generator = np.random.default_rng(4)
    for crossing in crossings(walks, 1, generator):
        middles = [markers.mean(axis=1) for markers in crossing.markers_m]
        apart = np.linalg.norm(middles[0] - middles[1], axis=1)
        assert abs(int(np.argmin(apart)) - len(apart) // 2) < 15  # they meet in the middle of the time
        assert apart.min() < crossing.apart_m + 0.2 < apart[0]
        assert play_pair(crossing, database, WITHOUT_PRIOR, generator)["longest_wrong_s"] <= 0.5
        break
    else:
        pytest.fail("nobody walks")


def test_two_meet_for_a_second(embedded_motion):
    boxing = [take for take in embedded_motion.values() if take.name.startswith("boxing")]
    stays = [sliced(resampled(take, FPS), 0, 150) for take in boxing]
    stays = {
        f"0{i}_01": replace(stay, root_positions_m=np.repeat(stay.root_positions_m[:1], 150, axis=0))
        for i, stay in enumerate(stays)
    }
    for meeting in meetings(stays, 2, np.random.default_rng(1)):
        hands = "hands" in meeting.title
        names = [marker.name for marker in true_subject(meeting.motion).marker_set.markers]
        parts = [markers[:, names.index("RHAN")] if hands else markers.mean(axis=1) for markers in meeting.markers_m]
        apart = np.linalg.norm(parts[0] - parts[1], axis=1)
        assert apart[75] < meeting.apart_m + (1e-6 if hands else 0.5)
        assert apart[75] < apart[0] - 0.5


def test_cuts_are_the_same_for_a_seed_and_hide_the_body_between(takes):
    first, again = (list(random_cuts(takes, 4, np.random.default_rng(2))) for _ in range(2))
    for cut, same in zip(first, again, strict=True):
        np.testing.assert_array_equal(cut.positions_m, same.positions_m)
        hidden = np.isnan(cut.positions_m).all(axis=(1, 2))
        np.testing.assert_array_equal(np.flatnonzero(hidden), np.arange(BEFORE, cut.back))
        assert cut.back == BEFORE + cut.hidden
        assert not cut.title.endswith(cut.subject)
    assert [cut.title.startswith("T pose > ") for cut in first] == [True, False, False, True]


def test_summary_reduces_columns_and_takes_ratios_of_sums():
    row = {"right_again_s": 0.0, "never_right": 0, "wrong_frames": 0, "doubted_wrong_frames": 0, "frames": AFTER}
    late = row | {"right_again_s": 1.0, "never_right": 1, "wrong_frames": 4, "doubted_wrong_frames": 1}
    found = {each["check"]: each["value"] for each in summary({"absences": [row, late], "cuts": [late]})}
    assert found["2 absences: right_again_s, median"] == 0.5
    assert found["2 absences: never_right, sum"] == 1
    assert found["2 absences: wrong_frames / frames"] == round(4 / (2 * AFTER), 4)
    assert found["1 cuts: doubted_wrong_frames / wrong_frames"] == 0.25
    assert not any("films" in check for check in found)


def test_a_motion_is_turned_without_a_change_of_its_shape(truth):
    turned = facing(truth, 0.7, np.array([1.0, 0.0, -2.0]))
    assert heading(turned) == pytest.approx(0.7)
    np.testing.assert_allclose(turned.root_positions_m[0], [1.0, truth.root_positions_m[0, 1], -2.0], atol=1e-12)
    np.testing.assert_array_equal(turned.rotations[:, 1:], truth.rotations[:, 1:])


def test_t_pose_stands_where_the_take_begins(truth):
    both = with_t_pose(truth)
    lead = both.frames - truth.frames
    assert lead == round(0.5 * truth.fps)
    np.testing.assert_array_equal(both.rotations[lead:], truth.rotations)
    np.testing.assert_allclose(both.rotations[:lead, 1:], np.repeat(t_pose(truth.skeleton)[None, 1:], lead, axis=0))
    np.testing.assert_allclose(both.root_positions_m[:lead], np.repeat(truth.root_positions_m[:1], lead, axis=0))
    assert heading(both) == pytest.approx(heading(truth))
