"""The course of a capture without Blender's window: a worker played by the test."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.errors import CaptureError
from perfanim.core.formats.take_file.pose_codec import TimedPose, pack_solved
from perfanim.core.worker.protocol import Decoder, Message, MessageKind, encode, encode_json, encode_preview
from perfanim.perfanim_addon.capture.capture_run import CaptureRun, Phase
from perfanim.perfanim_addon.capture.tuning import TUNING


class Clock:
    """A clock that the test moves."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@dataclass
class PlayedWorker:
    """Hands over what the test puts in."""

    waiting: list[Message] = field(default_factory=list)
    failure: CaptureError | None = None
    ended: bool = False
    asked_to_stop: bool = False
    taken: int = 0
    closed: bool = False
    may_restart: bool = False
    tuned: Any = None
    restarted: list[tuple[Any, str]] = field(default_factory=list)

    def restart(self, after: Any, cause: str) -> None:
        self.failure = None
        self.restarted.append((after, cause))

    def say(self, *data: bytes) -> None:
        self.waiting += Decoder().feed(b"".join(data))

    def poll(self) -> list[Message]:
        if self.failure is not None:
            raise self.failure
        taken, self.waiting = self.waiting, []
        self.ended = self.ended or any(message.kind is MessageKind.END for message in taken)
        return taken

    def acknowledge(self, frames: int) -> None:
        self.taken = frames

    def set_filter(self, shape: Any) -> None:
        self.tuned = shape

    def request_stop(self) -> None:
        self.asked_to_stop = True
        self.may_restart = False

    def close(self) -> None:
        self.closed = True


def poses(numbers: Sequence[int], stamp: float = 100.0, waiting: int = 0) -> list[bytes]:
    none, nowhere = np.empty(0, dtype=np.int64), np.empty((0, 3))
    made = [PerformerPose(n, n / 60, np.zeros((29, 4)), np.zeros(3), 0.5, nowhere, nowhere, none, 0.0) for n in numbers]
    return [
        encode(MessageKind.POSE, pack_solved(TimedPose(ScenePose((pose,)), stamp, 0.004, waiting))) for pose in made
    ]


def test_a_standing_warning_is_shown_until_it_is_taken_back() -> None:
    run, worker, _ = a_run()
    worker.say(encode_json(MessageKind.WARNING, {"text": "the take is not being written", "standing": True}))
    worker.say(encode_json(MessageKind.WARNING, {"text": "the left camera is back"}), *poses([0]))
    run.tick()
    assert run.notice == "the take is not being written"
    worker.say(encode_json(MessageKind.WARNING, {"text": "", "standing": True}))
    run.tick()
    assert run.notice == "the left camera is back"


def a_run() -> tuple[CaptureRun, PlayedWorker, Clock]:
    clock = Clock()
    worker = PlayedWorker()
    return CaptureRun(worker, clock), worker, clock


def test_every_pose_is_kept_and_the_newest_is_shown() -> None:
    run, worker, clock = a_run()
    assert run.tick() is None
    assert run.phase is Phase.STARTING
    worker.say(*poses([0, 1, 2], waiting=3))
    newest = run.tick()
    assert newest is not None
    assert newest.number == 2
    assert run.phase is Phase.RUNNING
    assert [pose.number for pose in run.poses] == [0, 1, 2]
    assert worker.taken == 3
    clock.now += 0.012
    run.shown()
    figures = run.statistics
    assert figures.latency_s == pytest.approx(0.012)
    assert (figures.solve_s, figures.confidence, figures.waiting) == (0.004, 0.5, 3)
    assert run.tick() is None  # nothing new: nothing to show


def test_stop_keeps_what_still_comes() -> None:
    run, worker, _ = a_run()
    worker.say(*poses([0, 1]))
    run.tick()
    run.stop()
    assert worker.asked_to_stop
    run.tick()
    assert run.phase is Phase.FINISHING  # the worker has not said that nothing follows
    worker.say(*poses([2, 3]), encode_json(MessageKind.END, {"frames": 4, "handed_over": 4}))
    run.tick()
    assert run.phase is Phase.DONE
    assert [pose.number for pose in run.poses] == [0, 1, 2, 3]
    assert run.statistics.handed_over == run.statistics.received == 4


def test_a_worker_that_does_not_stop_is_not_waited_for_forever() -> None:
    run, worker, clock = a_run()
    worker.say(*poses([0]))
    run.tick()
    run.stop()
    for number in range(1, 20):  # a long backlog is waited for, as long as poses come
        clock.now += 1.0
        worker.say(*poses([number]))
        run.tick()
        assert run.phase is Phase.FINISHING
    clock.now += TUNING.stop_limit_s + 1
    run.tick()
    assert run.phase is Phase.DONE
    assert len(run.poses) == 20


def test_the_end_of_a_video_ends_the_capture() -> None:
    run, worker, _ = a_run()
    worker.say(*poses([0, 1]), encode(MessageKind.END))
    run.tick()
    assert run.phase is Phase.DONE
    assert run.error is None
    assert len(run.poses) == 2


def test_an_error_keeps_what_was_captured() -> None:
    run, worker, _ = a_run()
    error = encode_json(MessageKind.ERROR, {"what": "froze", "where": "camera 1", "advice": "plug it in again"})
    worker.say(*poses([0, 1, 2]), error, encode(MessageKind.END))
    run.tick()
    assert run.phase is Phase.DONE
    assert len(run.poses) == 3
    assert str(run.error) == "camera 1: froze; plug it in again"


def test_a_dead_worker_ends_the_capture() -> None:
    run, worker, _ = a_run()
    worker.say(*poses([0]))
    run.tick()
    worker.failure = CaptureError("ended unexpectedly")
    run.tick()
    assert run.phase is Phase.DONE
    assert run.error is worker.failure
    assert len(run.poses) == 1


def test_a_worker_that_dies_is_replaced_and_the_capture_goes_on() -> None:
    run, worker, _ = a_run()
    worker.may_restart = True
    worker.failure = CaptureError("ended unexpectedly")
    run.tick()
    assert run.phase is Phase.DONE  # before the first pose it is an error as any other
    run, worker, _ = a_run()
    worker.may_restart = True
    worker.say(*poses([0, 1, 2, 3], stamp=99.5))
    run.tick()
    worker.failure = CaptureError("ended unexpectedly")
    run.tick()
    assert run.phase is Phase.RUNNING
    ((after, cause),) = worker.restarted
    assert (after.number, after.time_s, after.stamp_s) == (3, 3 / 60, 99.5)
    assert after.period_s == pytest.approx(1 / 60)
    assert cause == "the solver process ended unexpectedly"
    assert run.notice == "the solver process ended unexpectedly: restarting it"
    worker.say(*poses([60]))
    run.tick()
    assert run.notice == ""
    assert [pose.number for pose in run.poses] == [0, 1, 2, 3, 60]
    assert run.statistics.lost == 56
    worker.say(*poses([59, 60, 61]))  # what the first had not written comes once more
    run.tick()
    assert [pose.number for pose in run.poses] == [0, 1, 2, 3, 60, 61]
    assert worker.taken == 8
    run.stop()
    worker.failure = CaptureError("ended unexpectedly")
    run.tick()
    assert run.phase is Phase.DONE
    assert len(worker.restarted) == 1


def test_dropped_frames_and_silence_are_told() -> None:
    run, worker, clock = a_run()
    worker.say(*poses([0, 1, 4, 5, 9]))
    run.tick()
    assert run.statistics.lost == 5
    assert run.notice == ""
    clock.now += 3.0
    run.tick()
    assert run.notice == "no images for 3.0 s"


def test_how_busy_a_computer_is_does_not_change_with_every_reading() -> None:
    run, worker, _ = a_run()
    notices = set()
    for slowness in np.linspace(4.2, 6.8, 14):
        worker.say(encode_json(MessageKind.STATUS, {"stalled_s": 0.0, "slowness": slowness}))
        run.tick()
        notices.add(run.notice)
    assert notices == {"this computer is busy: work takes 5 times as long as usual; close other programs"}


def test_a_busy_computer_is_told_and_stop_has_more_time() -> None:
    run, worker, clock = a_run()
    worker.say(*poses([0]), encode_json(MessageKind.STATUS, {"stalled_s": 0.0, "slowness": 5.2}))
    run.tick()
    clock.now += 3.0
    assert run.notice == "this computer is busy: work takes 5 times as long as usual; close other programs"
    run.stop()
    clock.now += 3.0 * TUNING.stop_limit_s
    run.tick()
    assert run.phase is Phase.FINISHING
    worker.say(encode_json(MessageKind.STATUS, {"stalled_s": 0.0, "slowness": 1.1}))
    run.tick()
    assert "busy" not in run.notice


def test_several_notices_stand_the_busy_computer_last() -> None:
    run, worker, _ = a_run()
    worker.say(*poses([0]), encode_json(MessageKind.STATUS, {"stalled_s": 0.0, "slowness": 5.2}))
    worker.say(encode_json(MessageKind.WARNING, {"text": "camera 1 is darker than at calibration"}))
    worker.say(encode_json(MessageKind.WARNING, {"text": "the take is not being written", "standing": True}))
    run.tick()
    assert [notice.partition(":")[0] for notice in run.notices] == [
        "the take is not being written",
        "camera 1 is darker than at calibration",
        "this computer is busy",
    ]


def test_what_the_worker_does_is_told_until_poses_come() -> None:
    run, worker, _ = a_run()
    worker.say(encode_json(MessageKind.STATUS, {"activity": "learning the background", "fraction": 0.25}))
    run.tick()
    assert (run.activity, run.fraction) == ("learning the background", 0.25)
    worker.say(encode_json(MessageKind.WARNING, {"text": "camera 1 is darker than at calibration"}))
    run.tick()
    assert run.notice == "camera 1 is darker than at calibration"
    worker.say(*poses([0]), encode_json(MessageKind.STATUS, {"activity": "waiting for images"}))
    run.tick()
    assert run.activity == "capturing"


def test_what_was_dropped_is_told_by_stage() -> None:
    run, worker, _ = a_run()
    worker.say(*poses([0]), encode_json(MessageKind.STATUS, {"activity": "x", "skew_s": -0.0012, "blind": 4}))
    run.tick()
    worker.say(*poses([1, 2, 5]))  # two frames lost by the cameras, two poses overtaken by a newer one
    run.tick()
    figures = run.statistics
    assert (figures.lost, figures.blind, figures.not_shown) == (2, 4, 2)
    assert figures.skew_s == pytest.approx(-0.0012)
    worker.say(encode_json(MessageKind.STATUS, {"activity": "x", "skew_s": None, "blind": 9}))
    run.tick()
    assert (figures.skew_s, figures.blind) == (None, 9)
    worker.say(encode_json(MessageKind.STATUS, {"activity": "x"}))  # only a sign of life
    run.tick()
    assert figures.blind == 9


def test_the_rate_is_that_of_the_last_second() -> None:
    run, worker, clock = a_run()
    for number in range(180):
        worker.say(*poses([number]))
        clock.now += 1 / 60
        run.tick()
    assert run.statistics.frames_per_s == pytest.approx(60, abs=1.5)


def test_the_newest_picture_is_handed_out_once() -> None:
    run, worker, _ = a_run()
    assert run.take_preview() is None
    old, new = (np.full((2, 3, 3), value, np.uint8) for value in (1, 2))
    worker.say(encode_preview(old), encode_preview(new))
    assert run.tick() is None
    picture = run.take_preview()
    assert picture is not None
    np.testing.assert_array_equal(picture, new)
    assert run.take_preview() is None


def test_the_file_of_a_killed_worker_is_removed(tmp_path: Path) -> None:
    kept = tmp_path / "backgrounds.npz"
    kept.touch()
    run = CaptureRun(PlayedWorker(), temporary=str(kept))
    assert kept.exists()
    for _ in range(2):
        run.close()
        assert not kept.exists()
