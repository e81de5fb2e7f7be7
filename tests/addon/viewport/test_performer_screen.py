"""What the performer reads, and the drawn poses."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import CALIBRATION, INSTRUCTIONS
from perfanim.core.body.pose_notes import PoseNote
from perfanim.core.session.gestures import Gesture
from perfanim.core.worker.job_status import PoseCue
from solved_poses import scene_pose

HEIGHT = 720.0
BOX = (900.0, 30.0, 380.0, 300.0)  # left, bottom, width, top


@pytest.fixture
def view(part: Any) -> Any:
    return part("capture.performer_view").performer_view


@pytest.fixture
def running(part: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Let something run."""
    return lambda what: monkeypatch.setattr(part("capture.performer_view").activity, "current", lambda: what)


def capture_of(part: Any, poses: list[Any]) -> Any:
    capture = part("capture.live_capture").LiveCapture(None)
    capture.run = SimpleNamespace(poses=poses, activity="opening the cameras")
    return capture


def test_countdown_time_and_hidden_markers_are_read(part: Any, view: Any, running: Any) -> None:
    poses = [scene_pose(number) for number in range(150)]
    poses[-1] = type(poses[-1])(poses[-1].performers, (), (PoseNote.hidden(["left hand"]),))
    capture = capture_of(part, [])
    running(capture)
    assert (view(None).title, view(None).line) == ("Wait", "opening the cameras")
    capture.run.poses = poses
    capture.by_button = True
    shown = view(Gesture.CLAPS)
    assert (shown.title, shown.line, shown.problem) == ("Not recording", "Clap twice to start.", "left hand hidden")
    going = part("capture.capture_recording").Recording(3.0)
    capture.recordings.append(going)
    going.advance(poses)
    assert view(None).title == "3"
    going.begun, going.seconds_left = True, 0
    shown = view(Gesture.RAISED_HAND)
    assert (shown.title, shown.line) == ("REC 0:02", "Raise a hand to stop.")


def test_poses_to_take_are_named_and_drawn(part: Any, view: Any, running: Any) -> None:
    job = part("jobs.job").Job.__new__(part("jobs.job").Job)
    stages = part("capture.performer_view").PoseStage  # the extension has modules of its own
    job.title, job.text, job.cue = "Calibrating the performer", "learning the background", None
    running(job)
    assert (view(None).title, view(None).line, view(None).pose) == (job.title, job.text, "")
    for pose in CALIBRATION:
        job.text, job.cue = f"4: {INSTRUCTIONS[pose]}", PoseCue(stages.GET_READY, 4)
        assert (view(None).title, view(None).pose) == ("4", pose)
        job.text, job.cue = f"hold still: {INSTRUCTIONS[pose]}", PoseCue(stages.HOLD, 2)
        assert (view(None).title, view(None).pose) == ("Hold still", pose)
        assert view(None).line.lower().startswith(INSTRUCTIONS[pose][:20])


def test_the_drawing_fills_its_box_and_shows_the_arms(part: Any) -> None:
    module, widths = part("viewport.performer_screen"), {}
    for pose in CALIBRATION:
        corners = np.concatenate(module.pose_drawing(pose, BOX, HEIGHT).corners)
        low, high = corners.min(axis=0), corners.max(axis=0)
        assert low[0] > BOX[0] - 5 and high[0] < BOX[0] + BOX[2] + 5
        assert high[1] - low[1] > 0.5 * (BOX[3] - BOX[1])
        front = corners[corners[:, 0] < BOX[0] + 0.62 * BOX[2]]
        widths[pose] = float(np.ptp(front[:, 0]))
    assert widths["t"] > 2.0 * widths["hanging"]
    assert widths["t"] > 2.0 * widths["motorcycle"]


def test_a_gesture_ends_the_recording_before_it_and_starts_the_next(part: Any, chosen: Any, running: Any) -> None:
    poses = [scene_pose(number) for number in range(300)]
    capture = capture_of(part, poses)
    capture.run.stop = lambda: None
    chosen.record_by_button = capture.by_button = True
    capture.signal(chosen)
    (first,) = capture.recordings
    first.begun = True
    capture.signal(chosen, cut_s=1.5)
    assert first.over
    assert len(first.recorded(poses)) == pytest.approx(300 - 90, abs=1)
    assert not capture._stop_asked
    capture.by_button = False
    capture.signal(chosen)
    assert capture._stop_asked
