"""Takes of two performers: both solved, kept, exported."""

import numpy as np
import pytest
from commands import run
from perfanim.core.body.motion import sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.cli.main import main
from perfanim.core.database.store import identity
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.markers.subject import save_subject
from performers import AHEAD, side_by_side
from props import FPS, Film

FRAMES = 12
CLEARLY = 0.5  # of the error against the other's motion, who is a quarter of a stride off


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, record, true_markers, subject, database):
    """A take that was recorded for the one on the left: all points are in the frames."""
    film = Film(record)
    rows = np.concatenate(side_by_side(true_markers), axis=1)[:FRAMES]
    frames = [(n / FPS, film(row, n)) for n, row in enumerate(rows)]
    path = tmp_path_factory.mktemp("pair") / "walk.perftake"
    write_whole_take(
        path, TakeSetup.of(film.rig, (subject,), {}, identity(database), {}), TakeNotes("Walk"), frames, []
    )
    return path


@pytest.fixture
def partner(subject, tmp_path):
    path = tmp_path / "partner.toml"
    save_subject(subject, path)
    return path


def test_a_performer_named_later_is_found_in_what_was_recorded(recorded, partner, truth, subject, tmp_path, capsys):
    out = tmp_path / "walk.bvh"
    told = run(capsys, "solve", recorded, "--performer", partner, "--feet", "auto", "--out", out)
    beside = tmp_path / f"walk.{subject.name}.bvh"
    sure = pytest.approx(0.9, abs=0.1)
    row = {"name": subject.name, "confidence": sure, "verdict": "good", "out": str(beside)}
    assert told["performers"] == [row]
    first, second = read_motion(out), read_motion(beside)
    aside_m = second.root_positions_m[:, 0] - first.root_positions_m[:, 0]
    assert np.all(aside_m > 1.0)
    one, other = sliced(truth, 0, FRAMES), sliced(truth, AHEAD, AHEAD + FRAMES)
    for motion, own, foreign in ((first, one, other), (second, other, one)):
        assert evaluate(motion, own)["mpjpe_mm"] < CLEARLY * evaluate(motion, foreign)["mpjpe_mm"]


def test_takes_keep_performers_and_export_them(recorded, partner, subject, tmp_path, capsys):
    again = tmp_path / "again.perftake"
    run(capsys, "solve", recorded, "--performer", partner, "--out", again)
    assert [worn.name for worn in read_take_file(again).setup.subjects()[1:]] == [subject.name]
    (listed,) = run(capsys, "take", "info", again)["performers"]
    assert listed == {"name": subject.name, "confidence": pytest.approx(0.9, abs=0.1)}
    told = run(capsys, "take", "export", again, "--performer", subject.name, "--out", tmp_path / "partner.bvh")
    assert told["frames"] == FRAMES
    run(capsys, "take", "export", again, "--out", tmp_path / "first.bvh")
    aside_m = [read_motion(tmp_path / f"{name}.bvh").root_positions_m[0, 0] for name in ("partner", "first")]
    assert aside_m[0] > aside_m[1] + 1.0
    third = run(capsys, "solve", again, "--out", tmp_path / "third.bvh")  # with the performers that it has
    assert third["performers"][0]["name"] == subject.name


def test_wrong_uses_are_told(recorded, tmp_path, capsys):
    out = str(tmp_path / "a.bvh")
    assert main(["take", "export", str(recorded), "--performer", "Anna", "--out", out]) == 1
    assert "has no further performer 'Anna'; only one was recorded" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["solve", "a.csv", "--database", "d", "--subject", "s", "--performer", "p.toml", "--out", out])
    assert "only a .perftake" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
