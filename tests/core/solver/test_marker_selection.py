"""Few markers of a suit: which tell most of the body, and what the body is like with them alone."""

import json
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.cli.main import main
from perfanim.core.errors import MarkerSetError
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.marker_selection import choose_markers, with_markers, worn_in

NOISE_M = 0.001


@pytest.fixture(scope="module")
def suited(truth):
    return Subject("walker", truth.skeleton, load_marker_set("cmu-41"))


def test_each_marker_reduces_the_error_and_the_torso_comes_first(suited, database):
    choice = choose_markers(suited, database, 9)
    assert len(set(choice.names)) == 9
    markers = {marker.name: marker for marker in suited.marker_set.markers}
    assert all(markers[name].torso for name in choice.names[:4])
    assert all(markers[name].joint == "root" for name in choice.names[:2])
    assert np.all(np.diff(choice.expected_m) < 0.0)
    limbs = {markers[name].joint[1:] for name in choice.names[4:]}
    assert limbs & {"hand", "wrist", "radius", "humerus"}
    assert limbs & {"foot", "toes", "tibia"}


def test_choice_is_better_than_single_exchanges(suited, database):
    """Greedy: with the last marker exchanged for another the rest leaves more open."""
    choice = choose_markers(suited, database, 6)
    for name in ("LFHD", "LWRA", "RKNE", "LTOE"):
        if name not in choice.names:
            other = choose_markers(suited, database, 6, [*choice.names[:5], name])
            assert other.expected_m[-1] >= choice.expected_m[-1] - 1e-9


def test_too_few_markers_are_refused(suited, database):
    with pytest.raises(MarkerSetError, match="cannot choose 2 of 41 markers"):
        choose_markers(suited, database, 2)
    with pytest.raises(MarkerSetError, match="cannot choose 4 of 3 markers, 1 of them on the torso"):
        choose_markers(suited, database, 4, ["C7", "LFIN", "RFIN"])
    with pytest.raises(MarkerSetError, match="has no marker XX"):
        with_markers(suited, ["C7", "XX"])
    with pytest.raises(MarkerSetError, match="at least 3 markers with torso"):
        with_markers(suited, ["C7", "LFIN", "RFIN"])


def test_markers_are_chosen_with_whatever_torso_there_is(suited, truth, database):
    take, _ = simulate_markers(sliced(truth, 0, 10), suited.marker_set)
    names = [
        name for name in take.names if name not in ("C7", "T10", "CLAV", "STRN", "RBAC", "LSHO", "RSHO", "LBWT", "RBWT")
    ]
    part = replace(
        take, names=tuple(names), positions_m=take.positions_m[:, [take.names.index(name) for name in names]]
    )
    choice = choose_markers(worn_in(part, suited), database, 9)
    assert {"LFWT", "RFWT"} < set(choice.names)
    assert len(set(choice.names)) == 9


def test_a_suit_with_few_torso_markers_is_solved_with_nine(truth, database_file, tmp_path, capsys):
    worn = load_marker_set("helen-hayes")
    kept = [each.name for each in worn.markers if each.joint != "head" and each.name not in ("C7", "V.Sacral")]
    write_take(simulate_markers(sliced(truth, 0, 10), worn.subset(kept))[0], tmp_path / "part.csv")
    save_subject(Subject("walker", truth.skeleton, worn), tmp_path / "walker.toml")
    line = ["solve", tmp_path / "part.csv", "--subject", tmp_path / "walker.toml", "--database", database_file]
    line = [*line, "--use", 9, "--method", "nearest", "--causal", "--out", tmp_path / "a.bvh", "--json"]
    assert main([*map(str, line)]) == 0
    used = json.loads(capsys.readouterr().out)["used"]
    assert len(used) == 9 and set(used) < set(kept)
    assert sum(each.torso for each in worn.subset(used).markers) >= 3


def test_a_suit_is_solved_with_few_markers(suited, truth, database_file, tmp_path, capsys):
    """Those that are left out tell how far off the body is: further than the used ones, and told in full."""
    take, _ = simulate_markers(sliced(truth, 0, 20), suited.marker_set, noise_mm=1e3 * NOISE_M)
    write_take(take, tmp_path / "walk.csv")
    save_subject(suited, tmp_path / "walker.toml")
    line = ["solve", tmp_path / "walk.csv", "--database", database_file, "--subject", tmp_path / "walker.toml"]
    line = [*map(str, [*line, "--out", tmp_path / "a.bvh"]), "--json"]
    told = {}
    for use in ("9", "lfwt", "C7,STRN,LFWT,RFWT,LFIN,RFIN,LTOE,RTOE"):
        status = main([*line, "--use", use])
        captured = capsys.readouterr()
        told[use] = json.loads(captured.out) if status == 0 else captured.err
    assert "has no marker lfwt" in told["lfwt"]
    nine, named = told["9"], told["C7,STRN,LFWT,RFWT,LFIN,RFIN,LTOE,RTOE"]
    assert (len(nine["used"]), len(nine["expected_mm"]), nine["markers"]) == (9, 9, 41)
    assert set(named["used"]) == {"C7", "STRN", "LFWT", "RFWT", "LFIN", "RFIN", "LTOE", "RTOE"}
    for answer in (nine, named):
        assert answer["marker_rms_mm"] < answer["left_out_rms_mm"] < 100.0
    assert nine["left_out_rms_mm"] < 2.0 * nine["expected_mm"][-1]
