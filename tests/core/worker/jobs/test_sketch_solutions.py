"""The worker's job of sketches: messages as they were; live, a picture and the whole, newest first."""

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.cli.main import main
from perfanim.core.database.store import open_database
from perfanim.core.errors import SettingsError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.subject import skeleton_table
from perfanim.core.sketch.sketch_file import Control, Sketch
from perfanim.core.sketch.sketch_messages import settings_from, sketch_from, solution_from, solution_table
from perfanim.core.sketch.solve_sketch import SketchSettings, SketchSolver
from perfanim.core.system.assets import MOTION
from perfanim.core.system.schema import table_of
from perfanim.core.worker.jobs import sketch_solutions as job
from perfanim.core.worker.requests import read_request

WALK = sliced(resampled(read_motion(MOTION / "walking-01-neutral.bvh"), 30.0), 0, 31)


class PlayedChannel:
    """Blender's requests, and what the job sends.

    Args:
        waits: the next edit comes while one is solved, else after it.
    """

    def __init__(self, requests: list[dict[str, Any]], waits: bool = True) -> None:
        self.requests, self.waits, self.sent = requests, waits, []
        self.stop_requested = threading.Event()

    def send_status(self, text: str, fraction: float) -> None:
        """Hear of progress."""

    @property
    def has_request(self) -> bool:
        return self.waits and self.requests[0] != {}

    def send_result(self, table: dict[str, Any]) -> None:
        self.sent.append(solution_from(json.loads(json.dumps(table))))

    def newest_request(self) -> dict[str, Any]:
        return self.requests.pop(0)


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("database") / "walk.pfdb"
    clip = str(MOTION / "walking-02-energetic.bvh")
    assert main(["database", "build", clip, "--fps", "30", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def sketch() -> Sketch:
    positions = forward_kinematics(WALK.skeleton, WALK.rotations, WALK.root_positions_m)[0]
    at = np.array([0, 15, 30])
    joints = ("root", "lfoot", "rfoot")
    return Sketch(
        "walk", 30.0, tuple(Control(j, at.astype(float), positions[at, WALK.skeleton.index(j)]) for j in joints)
    )


def request(database: Path, sketch: Sketch, number: int, **more: Any) -> dict[str, Any]:
    edit = {"number": number, "frame": 15, "sketch": table_of(sketch), "settings": table_of(SketchSettings())}
    whole = {"skeleton": skeleton_table(WALK.skeleton), "database": str(database), **edit, **more}
    return dict(json.loads(json.dumps(whole)))


def test_messages_come_back_as_they_were(database: Path, sketch: Sketch) -> None:
    back = sketch_from(json.loads(json.dumps(table_of(sketch))))
    assert (back.name, back.fps) == (sketch.name, sketch.fps)
    for mine, theirs in zip(back.controls, sketch.controls, strict=True):
        assert mine.joint == theirs.joint
        np.testing.assert_array_equal(mine.frames, theirs.frames)
        np.testing.assert_array_equal(mine.positions_m, theirs.positions_m)
    chosen = SketchSettings(0.7, ("walk*", "box*"), 2, False)
    assert settings_from(json.loads(json.dumps(table_of(chosen)))) == chosen
    solution = SketchSolver(WALK.skeleton, open_database(database)).solve(sketch)
    table = json.loads(json.dumps(solution_table(solution, 4)))
    solved = solution_from(table)
    np.testing.assert_allclose(solved.rotations, solution.motion.rotations, atol=1e-6)
    np.testing.assert_allclose(solved.root_positions_m, solution.motion.root_positions_m, atol=1e-6)
    assert (solved.number, solved.whole, solved.drawn_from) == (4, True, solution.drawn_from)


@pytest.mark.parametrize("damaged", [{}, {"controls": [{"joint": "root"}]}, {"name": "x", "fps": "y", "controls": []}])
def test_damaged_messages_are_refused(damaged: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match=r"lacks|must be"):
        sketch_from(damaged)
    with pytest.raises(SettingsError, match="follow must be a number from 0 to 1"):
        settings_from({"follow": 2.0, **damaged})


def test_a_newer_edit_ends_the_older(database: Path, sketch: Sketch) -> None:
    edits = [request(database, sketch, number) for number in (2, 3)]
    channel = PlayedChannel([*edits, {}])
    job.run(read_request("sketch", request(database, sketch, 1, live=True)), channel)
    assert [(each.number, each.whole) for each in channel.sent] == [(3, True)]


def test_an_edit_is_answered_by_the_shown_frame_before_the_whole(database: Path, sketch: Sketch) -> None:
    channel = PlayedChannel([request(database, sketch, 2), {}], waits=False)
    job.run(read_request("sketch", request(database, sketch, 1, live=True)), channel)
    assert [(each.number, each.whole, len(each.rotations)) for each in channel.sent] == [
        (1, True, 31), (2, False, 1), (2, True, 31),
    ]  # fmt: skip
    _, picture, whole = channel.sent
    np.testing.assert_allclose(picture.root_positions_m[0], whole.root_positions_m[15], atol=1e-5)


def test_a_bad_live_edit_is_answered(database: Path, sketch: Sketch) -> None:
    bad = request(database, sketch, 2)
    bad["settings"]["behaviours"] = ["swim*"]
    channel = PlayedChannel([bad, request(database, sketch, 3), {}], waits=False)
    job.run(read_request("sketch", request(database, sketch, 1, live=True)), channel)
    errors = {each.number: each.error for each in channel.sent if each.error}
    assert list(errors) == [2]
    assert "swim" in errors[2]
    assert [each.number for each in channel.sent if each.whole and not each.error] == [1, 3]
