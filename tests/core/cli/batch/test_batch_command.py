"""`perfanim batch` as a command: its answers, and what it refuses before any work."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers

FRAMES = 8


@pytest.fixture(scope="module")
def folder(truth, subject, database_file, tmp_path_factory):
    """A plan, its takes, one of which is bad, and all they need."""
    place = tmp_path_factory.mktemp("plan")
    walk = simulate_markers(truth, subject)[0]
    write_take(MarkerTake("walk", walk.fps, walk.names, walk.positions_m[:FRAMES]), place / "walk.trc")
    write_take(MarkerTake("other", walk.fps, ("C7", "T10"), np.zeros((FRAMES, 2, 3))), place / "other.csv")
    save_subject(subject, place / "walker.toml")
    shutil.copyfile(database_file, place / "all.pfdb")
    (place / "plan.toml").write_text("""
        out = "results"
        database = "all.pfdb"
        subject = "walker.toml"
        naming = "mixamo"
        also = ["vrma", "angles.csv"]
        [[take]]
        take = "walk.trc"
        marker_set = "auto"
        [[take]]
        take = "other.csv"
        [[take]]
        take = "none.c3d"
        """)
    return place


def test_a_plan_with_bad_takes(folder, capsys):
    assert main(["batch", str(folder / "plan.toml"), "--jobs", "1", "--json"]) == 1
    printed = capsys.readouterr()
    told = json.loads(printed.out)
    assert printed.err == f"perfanim: {folder / 'results'}: bad takes: 2 of 3; see {told['page']}\n"
    assert (told["good"] + told["doubtful"], told["bad"], told["finished_before"]) == (1, 2, 0)
    none, other, walk = told["takes"]
    assert (none["name"], none["status"]) == ("none", "bad")
    assert none["reasons"][0].startswith("cannot be read")
    assert "choose the marker set that was worn" in other["reasons"][0]
    assert walk["take"] == "walk.trc"
    assert walk["figures"]["frames"] == FRAMES
    assert {"motion", "vrma", "angles.csv"} < set(walk["outputs"])
    assert "ROOT mixamorig:Hips" in Path(walk["outputs"]["motion"]).read_text()
    assert read_motion(walk["outputs"]["motion"]).frames == FRAMES
    assert all(Path(place).is_file() for place in (told["page"], *walk["outputs"].values()))
    assert main(["batch", str(folder / "plan.toml")]) == 1
    printed = capsys.readouterr()
    assert "3 from an earlier run" in printed.out
    assert any(line.split()[:2] == ["other", "bad"] for line in printed.out.splitlines())


def test_good_takes_alone_exit_with_0(folder, tmp_path, capsys):
    shutil.copytree(folder / "results", tmp_path / "out")  # done there already: content counts, not places
    given = ["--database", str(folder / "all.pfdb"), "--subject", str(folder / "walker.toml")]
    given += ["--naming", "mixamo", "--also", "angles.csv", "--also", "vrma", "--marker-set", "auto"]
    assert main(["batch", str(folder / "walk.trc"), *given, "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = capsys.readouterr()
    assert (json.loads(printed.out)["finished_before"], printed.err) == (1, "")


def test_results_below_the_takes_are_no_takes(folder, tmp_path, capsys):
    (tmp_path / "takes").mkdir()
    shutil.copyfile(folder / "walk.trc", tmp_path / "takes" / "walk.trc")
    given = ["--database", str(folder / "all.pfdb"), "--subject", str(folder / "walker.toml"), "--also", "angles.csv"]
    line = ["batch", str(tmp_path / "takes"), *given, "--out", str(tmp_path / "takes" / "solved"), "--json"]
    for finished_before in (0, 1):
        assert main([*line, "--method", "nearest", "--jobs", "1"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert ([row["name"] for row in told["takes"]], told["finished_before"]) == (["walk"], finished_before)


def test_takes_with_z_up_stand(folder, tmp_path, capsys):
    """As `perfanim solve` brings them in; Motive's prefix of the performer's name does not matter either."""
    walk = read_take(folder / "walk.trc")
    turned = walk.positions_m @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]).T
    names = tuple(f"Anna:{name}" for name in walk.names)
    write_take(MarkerTake("walk", walk.fps, names, turned), tmp_path / "turned.c3d")
    (tmp_path / "plan.toml").write_text(f"""
        database = '{folder / "all.pfdb"}'
        subject = '{folder / "walker.toml"}'
        method = "nearest"
        [[take]]
        take = '{folder / "walk.trc"}'
        [[take]]
        take = "turned.c3d"
        """)
    assert main(["batch", str(tmp_path / "plan.toml"), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    capsys.readouterr()
    walked, turned_back = (read_motion(tmp_path / "out" / f"{name}.bvh") for name in ("walk", "turned"))
    heights = [motion.root_positions_m[:, 1] for motion in (turned_back, walked)]
    np.testing.assert_allclose(*heights, atol=1e-4)  # the files keep a hundredth of that


BAD = [
    (["--database", "none.pfdb"], "none.pfdb", 1),
    (["--subject", "plan.toml"], "plan.toml: is not a subject file", 1),
    (["--marker-set", "nowhere"], "no marker set", 1),
    (["--to", "none.glb"], "none.glb: cannot be read", 1),
    (["--jobs", "0"], "--jobs 0 is out of range", 1),
    (["--method", "guess"], "invalid choice", 2),
    (["--jobs", "2", "--scheduler", "tcp://here:1"], "--scheduler", 2),
    (["walk.trc"], "a plan must be the only argument", 2),
]


@pytest.mark.parametrize(("options", "said", "status"), BAD)
def test_what_is_refused_before_any_work(folder, tmp_path, capsys, monkeypatch, options, said, status):
    monkeypatch.chdir(folder)
    line = ["batch", "plan.toml", *options, "--out", str(tmp_path / "out")]
    if status == 2:
        with pytest.raises(SystemExit, match="2"):
            main(line)
    else:
        assert main(line) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('subject = "walker.toml"\n[[take]]\ntake = "walk.trc"', "required: --database"),
        ('database = "all.pfdb"\nsubject = "walker.toml"\nunits = "yd"\n[[take]]\ntake = "walk.trc"', "--units"),
        (
            'database = "all.pfdb"\nsubject = "walker.toml"\ntempo = 1\n[[take]]\ntake = "walk.trc"',
            "unknown key 'tempo'",
        ),
    ],
)
def test_options_that_cannot_be_meant(folder, capsys, text, said):
    (folder / "wrong.toml").write_text(text)
    assert main(["batch", str(folder / "wrong.toml"), "--out", str(folder / "none")]) == 1
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1
    assert not (folder / "none").exists()
