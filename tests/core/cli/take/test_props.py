"""Takes of a performer with a sword: solved again with it, and where it was as a table."""

import csv

import numpy as np
import pytest
from commands import run
from perfanim.core.cli.main import main
from perfanim.core.database.store import identity
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.prop import load_prop, save_prop
from props import FPS, Film, held_poses, markers_of

FRAMES = 20
HIDDEN = range(8, 12)
PLACE_M = 0.008  # as in test_prop_tracking


@pytest.fixture(scope="module")
def sword_poses(truth):
    return held_poses(load_prop("sword"), truth)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, record, true_markers, subject, database, sword_poses):
    """A take that was recorded without the prop being known: its points are in the frames."""
    film, turns_places = Film(record), sword_poses
    points = np.concatenate((true_markers, markers_of(load_prop("sword"), *turns_places)), axis=1)[:FRAMES]
    hidden = tuple((marker, -1) for marker in range(8, 13))
    frames = [(n / FPS, film(row, n, hidden if n in HIDDEN else ())) for n, row in enumerate(points)]
    path = tmp_path_factory.mktemp("sword") / "walk.perftake"
    write_whole_take(
        path, TakeSetup.of(film.rig, (subject,), {}, identity(database), {}), TakeNotes("Walk"), frames, []
    )
    return path


def check_table(path, sword_poses):
    with path.open(encoding="utf-8") as file:
        assert file.readline().startswith("# prop of perfanim: sword, metres, y up, fps=60")
        rows = list(csv.DictReader(file))
    assert [int(row["frame"]) for row in rows] == list(range(FRAMES))
    for number, row in enumerate(rows):
        assert (row["x"] == "") == (number in HIDDEN)
        if row["x"]:
            turn, place = sword_poses[0][number], sword_poses[1][number]
            assert np.linalg.norm([float(row[axis]) for axis in "xyz"] - place) < PLACE_M
            found = [float(row[f"q{axis}"]) for axis in "wxyz"]
            assert np.degrees(rot.angle_between(found, turn)) < 3.0
            assert (row["markers"], float(row["rms_mm"]) < 5.0) == ("5", True)


def test_a_prop_that_is_named_later_is_found_in_what_was_recorded(recorded, sword_poses, tmp_path, capsys):
    save_prop(load_prop("sword"), tmp_path / "mine.toml")
    told = run(capsys, "solve", recorded, "--prop", tmp_path / "mine.toml", "--out", tmp_path / "walk.bvh")
    assert told["props"] == {"sword": pytest.approx(1.0 - len(HIDDEN) / FRAMES)}
    check_table(tmp_path / "walk.sword.csv", sword_poses)


def test_takes_keep_props_and_export_them(recorded, sword_poses, tmp_path, capsys):
    again = tmp_path / "again.perftake"
    run(capsys, "solve", recorded, "--prop", "sword", "--out", again)
    take = read_take_file(again)
    assert take.setup.carried_props()[0].name == "sword"
    assert [solved.pose.props[0].found for solved in take.poses] == [n not in HIDDEN for n in range(FRAMES)]
    assert run(capsys, "take", "info", again)["props"] == {"sword": pytest.approx(1.0 - len(HIDDEN) / FRAMES)}
    told = run(capsys, "take", "export", again, "--prop", "sword", "--out", tmp_path / "sword.csv")
    assert told["frames"] == FRAMES
    check_table(tmp_path / "sword.csv", sword_poses)
    third = run(capsys, "solve", again, "--out", tmp_path / "third.bvh")  # with the props that it has
    assert third["props"] == {"sword": pytest.approx(1.0 - len(HIDDEN) / FRAMES)}


def test_wrong_uses_are_told(recorded, tmp_path, capsys):
    assert main(["take", "export", str(recorded), "--prop", "sword", "--out", str(tmp_path / "a.csv")]) == 1
    assert "has no prop 'sword'; none was recorded" in capsys.readouterr().err
    assert main(["take", "export", str(recorded), "--prop", "sword", "--out", str(tmp_path / "a.trc")]) == 1
    assert "does not end in .csv" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["solve", "a.csv", "--database", "d", "--subject", "s", "--prop", "sword", "--out", "a.bvh"])
    assert "only a .perftake" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
