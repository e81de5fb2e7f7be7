"""The steps of one take: which commands it goes through, with what, and what is left when one fails."""

from dataclasses import replace
from pathlib import Path

import pytest
from perfanim.core.body.motion import resampled
from perfanim.core.cli.batch.plan import TakePlan
from perfanim.core.cli.batch.process_take import run_task
from perfanim.core.cli.batch.take_record import BAD, Record, Task
from perfanim.core.errors import CharacterError, TakeError
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings


class Noted:
    """Commands that write what they were asked for and note it; one of them may fail."""

    def __init__(self, solved, fails=None):
        self.lines = []
        self._solved = solved
        self._fails = fails

    def run(self, command, options):
        self.lines.append((command, *options))
        if command == self._fails:
            raise {"track": TakeError, "solve": TakeError, "retarget": CharacterError}[command]("went wrong")
        Path(options[options.index("--out") + 1]).write_text(command)
        if command == "track":
            return {"warnings": ["a camera is late"]}
        return {"doubtful": {"lwrist": "no bone like it"}, "unmapped": {"head": "none"}}

    def solve(self, options):
        self.run("solve", options)
        return self._solved, {"warnings": [f"{options[0]}: odd"]}


@pytest.fixture(scope="module")
def solved(truth, subject, database):
    take = simulate_markers(truth, subject)[0]
    worn = Subject(subject.name, subject.skeleton, subject.marker_set)
    return solve_take(take, worn, database, SolveSettings(method="nearest"), lambda fraction, text: None)


@pytest.fixture
def task(tmp_path):
    options = {"cameras": "rig.toml", "left": "l.mp4", "right": "r.mp4", "database": "d.pfdb", "to": "hero.glb"}
    plan = TakePlan("wave", "l.mp4", "", options, "digest")
    (tmp_path / "out").mkdir()
    return Task.of_text(Task(plan, str(tmp_path / "out"), str(tmp_path / "work")).text())


def test_videos_become_a_character(task, solved, tmp_path):
    commands, work = Noted(solved), tmp_path / "work" / "wave"
    record = run_task(task, commands)
    videos = ("--cameras", "rig.toml", "--left", "l.mp4", "--right", "r.mp4")
    assert commands.lines == [
        ("track", *videos, "--database", "d.pfdb", "--out", str(work / "wave.take.npz")),
        ("solve", str(work / "wave.take.npz"), "--database", "d.pfdb", "--out", str(work / "wave.bvh")),
        ("retarget", str(work / "wave.bvh"), "--to", "hero.glb", "--out", str(work / "wave.blend")),
    ]
    assert record.outputs == {
        "markers": "wave.take.npz",
        "motion": "wave.bvh",
        "picture": "report/wave.jpg",
        "character": "wave.blend",
    }
    told = ("a camera is late", "wave.take.npz: odd", "joints whose bone is doubtful or missing: head, lwrist")
    assert record.warnings == told
    assert sorted(record.sha256) == sorted(record.outputs.values())
    out = tmp_path / "out"
    assert Record.of_text((out / "report" / "wave.json").read_text()) == record
    assert (out / "wave.blend").read_text() == "retarget"
    assert not work.exists()


def test_motion_and_character_in_other_forms(task, solved, tmp_path):
    options = {**task.take.options, "also": ["angles.csv", "vrma"], "rate": 15.0, "naming": "vrm", "save_as": "fbx"}
    commands = Noted(solved)
    record = run_task(replace(task, take=replace(task.take, options=options)), commands)
    assert commands.lines[1][-6:-2] == ("--rate", "15.0", "--naming", "vrm")
    assert commands.lines[2][-1].endswith("wave.fbx")
    outputs = {key: record.outputs[key] for key in ("angles.csv", "vrma", "character")}
    assert outputs == {"angles.csv": "wave.angles.csv", "vrma": "wave.vrma", "character": "wave.fbx"}
    table = (tmp_path / "out" / "wave.angles.csv").read_text().splitlines()
    assert table[3].endswith("rightThumbMetacarpal_y_deg")
    assert len(table) - 4 == resampled(solved.motion, 15.0).frames
    assert (tmp_path / "out" / "wave.vrma").read_bytes().startswith(b"glTF")


@pytest.mark.parametrize(
    ("step", "is_kept", "whole"), [("track", True, []), ("solve", True, ["wave.take.npz"]), ("retarget", False, [])]
)
def test_a_step_that_fails(task, solved, tmp_path, step, is_kept, whole):
    """What was tracked is of use without a motion, and was dear."""
    record = run_task(task, Noted(solved, fails=step))
    assert (record.status, record.reasons, record.is_kept) == (BAD, ("went wrong",), is_kept)
    assert list(record.outputs.values()) == whole
    left = [path.name for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert sorted(left) == ["wave.json"] * is_kept + whole


def test_what_nobody_foresaw_is_told_and_tried_again(task, solved):
    commands = Noted(solved)
    commands.solve = lambda options: 1 / 0
    record = run_task(task, commands)
    assert (record.status, record.is_kept) == (BAD, False)
    assert "ZeroDivisionError" in record.reasons[0]
