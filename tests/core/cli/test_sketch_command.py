"""`perfanim sketch`: one sketch, several, and those that are none."""

import json

import numpy as np
import pytest
from bench.sketch import sketch_of
from perfanim.core.cli.main import main
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion


@pytest.fixture
def body(truth, tmp_path):
    path = tmp_path / "body.bvh"
    write_bvh(truth, path)
    return path


@pytest.fixture
def keys(truth, tmp_path):
    """Write the keys of hips and hands, from frame 5 on."""
    path = tmp_path / "walk.csv"
    rows = [
        f"{control.joint},{frame + 5:.0f},{x},{y},{z}"
        for control in sketch_of(truth, ("root", "lhand", "rhand"), "16").controls
        for frame, (x, y, z) in zip(control.frames, control.positions_m, strict=True)
    ]
    path.write_text("# fps=30\ncontrol,frame,x,y,z\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def solve(capsys, *options):
    status = main(["sketch", *map(str, options)])
    return status, capsys.readouterr()


def test_a_sketch_becomes_a_motion_with_its_frames(capsys, keys, body, database_file, truth, tmp_path):
    out = tmp_path / "new folder" / "walk.bvh"
    status, said = solve(capsys, keys, "--database", database_file, "--skeleton", body, "--out", out, "--json")
    assert status == 0
    facts = json.loads(said.out)
    assert facts["frames"] == truth.frames
    assert facts["keys"] == 15
    assert facts["keys_met_mm"] < 5.0
    assert (facts["keys_unmet"], facts["first_frame"]) == (0, 5)
    motion = read_motion(out)
    assert motion.frames == truth.frames + 5
    np.testing.assert_allclose(motion.root_positions_m[5], truth.root_positions_m[0], atol=0.005)


def test_a_bad_sketch_does_not_stop_the_others(capsys, keys, body, database_file, tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_text("# fps=30\ncontrol,frame,x,y,z\nelbow,1,0,0,0\n", encoding="utf-8")
    out = tmp_path / "solved"
    status, said = solve(capsys, bad, keys, "--database", database_file, "--skeleton", body, "--out", out, "--json")
    assert status == 1
    assert "1 of 2 sketches failed" in said.err
    assert "there is no joint 'elbow'" in said.err
    assert [path.name for path in out.iterdir()] == ["walk.bvh"]
    assert json.loads(said.out)["failed"] == 1


@pytest.mark.parametrize(
    ("out", "more", "message"),
    [
        ("walk.txt", (), "does not have the extension of a motion file"),
        ("walk.bvh", ("--follow", "2"), "--follow must be a number from 0 to 1"),
        ("walk.bvh", ("--behaviour", "swim"), "no clip has the behaviour swim"),
    ],
)
def test_what_cannot_be_is_told_in_a_line(capsys, keys, body, database_file, tmp_path, out, more, message):
    status, said = solve(capsys, keys, "--database", database_file, "--skeleton", body, "--out", tmp_path / out, *more)
    assert status == 1
    assert message in said.err
    assert len(said.err.splitlines()) == 1
    assert not (tmp_path / out).exists()


def test_several_sketches_need_a_folder_and_names_of_their_own(capsys, keys, body, database_file, tmp_path):
    options = ("--database", database_file, "--skeleton", body)
    status, said = solve(capsys, keys, keys, *options, "--out", tmp_path / "walk.bvh")
    assert status == 1
    assert "cannot hold several sketches" in said.err
    status, said = solve(capsys, keys, keys, *options, "--out", tmp_path / "solved")
    assert status == 1
    assert "two sketches have the same name" in said.err


def test_a_table_needs_a_skeleton(keys, database_file, tmp_path, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["sketch", str(keys), "--database", str(database_file), "--out", str(tmp_path / "walk.bvh")])
    assert caught.value.code == 2
    assert "--subject --skeleton is required" in capsys.readouterr().err
