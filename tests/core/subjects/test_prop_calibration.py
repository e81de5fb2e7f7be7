"""Props measured from takes of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.database.store import identity
from perfanim.core.errors import PropError
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.markers.marker_take import MarkerTake, save_take
from perfanim.core.markers.prop import load_prop
from perfanim.core.subjects.prop_calibration import calibrate_prop
from props import FPS, Film, markers_of, swung

NOISE_M = 0.001
FRAMES = 60


@pytest.fixture(scope="module")
def sword():
    return load_prop("sword")


def waved(sword, hidden=0.1, seed=5):
    """A take in which the sword is waved, markers hidden now and then, with noise."""
    generator = np.random.default_rng(seed)
    points = markers_of(sword, *swung(FRAMES, seed)) + generator.normal(scale=NOISE_M, size=(FRAMES, 5, 3))
    points[generator.random((FRAMES, 5)) < hidden] = np.nan
    return MarkerTake("waved", FPS, sword.names, points)


def spans_off(found, sword):
    order = [sword.names.index(name) for name in found.names] if found.names[0] in sword.names else slice(None)
    return np.abs(found.spans_m - sword.spans_m[order][:, order]).max()


def test_a_waved_prop_is_measured_to_the_noise(sword):
    found = calibrate_prop(waved(sword), "mine")
    assert (found.prop.name, found.left_out, found.advice) == ("mine", (), ())
    assert spans_off(found.prop, sword) < 5.0 * np.sqrt(2.0 / (0.8 * FRAMES)) * NOISE_M  # each pair in 81 % of them
    assert found.prop.residual_m == pytest.approx(np.sqrt(3.0) * NOISE_M, rel=0.3)


def test_its_own_frame_is_upright_and_always_the_same(sword):
    first, second = (calibrate_prop(waved(sword, seed=seed), "mine").prop.positions_m for seed in (1, 2))
    np.testing.assert_allclose(first, second, atol=10.0 * NOISE_M)
    np.testing.assert_allclose(first.mean(axis=0), 0.0, atol=1e-12)
    assert np.argmax(np.ptp(first, axis=0)) == 1
    assert np.linalg.det(np.linalg.lstsq(first, sword.positions_m - sword.positions_m.mean(axis=0), rcond=None)[0]) > 0


def test_what_moves_beside_it_is_left_out(sword):
    take = waved(sword)
    t = np.arange(FRAMES)[:, None, None] / FPS
    others = np.array([[0.5, 1.0, 0.0], [0.5, 1.2, 0.1]]) + 0.1 * np.sin(t * np.array([[[3.0], [4.0]]]))
    both = MarkerTake("both", FPS, ("H1", *sword.names, "H2"), np.concatenate(
        (others[:, :1], take.positions_m, others[:, 1:]), axis=1))  # fmt: skip
    found = calibrate_prop(both, "mine")
    assert found.left_out == ("H1", "H2")
    assert found.prop.names == sword.names
    assert calibrate_prop(both, "mine", ("POMMEL", "GUARD1", "TIP")).prop.names == ("POMMEL", "GUARD1", "TIP")


def test_three_markers_will_do_and_a_fourth_is_advised(sword):
    found = calibrate_prop(waved(sword), "mine", sword.names[:3])
    assert "fourth marker" in found.advice[0]


def test_what_is_no_prop_is_refused(sword):
    generator = np.random.default_rng(0)
    loose = MarkerTake(
        "loose", FPS, tuple("ABCD"), np.cumsum(generator.normal(scale=0.02, size=(FRAMES, 4, 3)), axis=0)
    )
    with pytest.raises(PropError, match="no 3 of its 4 markers form a rigid group"):
        calibrate_prop(loose, "mine")
    with pytest.raises(PropError, match="no marker X"):
        calibrate_prop(loose, "mine", ("X",))
    take = waved(sword, hidden=0.0)
    shy = take.positions_m.copy()
    shy[np.arange(FRAMES), np.arange(FRAMES) % 5] = np.nan
    with pytest.raises(PropError, match="never all seen at once"):
        calibrate_prop(replace(take, positions_m=shy), "mine")
    two = np.concatenate((take.positions_m[:, :3], markers_of(sword, *swung(FRAMES, 9))[:, :3]), axis=1)
    with pytest.raises(PropError, match=r"may be (A, B, C or D, E, F|D, E, F or A, B, C)"):
        calibrate_prop(MarkerTake("two", FPS, tuple("ABCDEF"), two), "mine")
    still = np.broadcast_to(generator.uniform(-1.0, 1.0, (14, 3)), (FRAMES, 14, 3))
    with pytest.raises(PropError, match="14 markers form one rigid group, but a prop has at most 12"):
        calibrate_prop(MarkerTake("room", FPS, tuple("ABCDEFGHIJKLMN"), still), "mine")


def test_the_command_measures_marker_takes_and_recorded_ones(sword, tmp_path, capsys, record, subject, database):
    save_take(waved(sword), tmp_path / "waved.take.npz")
    film = Film(record)
    rows = markers_of(sword, *swung(FRAMES))
    frames = [(n / FPS, film(row, n)) for n, row in enumerate(rows)]
    setup = TakeSetup.of(film.rig, (subject,), {}, identity(database), {})
    write_whole_take(tmp_path / "waved.perftake", setup, TakeNotes("Waved"), frames, [])
    for take in ("waved.take.npz", "waved.perftake"):
        out = tmp_path / "my-sword.toml"
        assert main(["calibrate", "prop", str(tmp_path / take), "--out", str(out), "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert (told["name"], told["left_out"]) == ("my-sword", [])
        assert len(told["markers_mm"]) == 5
        found = load_prop(out)
        # a recorded take names its trajectories itself: compare by sorted distances
        mine, true = (np.sort(prop.spans_m[np.triu_indices(5, 1)]) for prop in (found, sword))
        np.testing.assert_allclose(mine, true, atol=0.002)
    line = ["calibrate", "prop", str(tmp_path / "waved.take.npz"), "--frames", "0:20", "--markers", "TIP,BLADE"]
    assert main([*line, "--out", str(tmp_path / "no.toml")]) == 1
    assert "2 markers cannot define a pose" in capsys.readouterr().err
    assert not (tmp_path / "no.toml").exists()
