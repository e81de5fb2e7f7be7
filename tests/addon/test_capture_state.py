"""The course of a capture without Blender's window: a worker and a session played by the test."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.marker_frame import MarkerFrame
from perfanim.core.pose_frame import PoseFrame
from perfanim.core.worker.protocol import Decoder, Message, MessageKind, encode, encode_frame, encode_json
from perfanim.perfanim_addon.capture_state import STOP_LIMIT_S, CaptureRun, Phase


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
    closed: bool = False

    def say(self, *data: bytes) -> None:
        self.waiting += Decoder().feed(b"".join(data))

    def poll(self) -> list[Message]:
        if self.failure is not None:
            raise self.failure
        taken, self.waiting = self.waiting, []
        self.ended = self.ended or any(message.kind is MessageKind.END for message in taken)
        return taken

    def request_stop(self) -> None:
        self.asked_to_stop = True

    def close(self) -> None:
        self.closed = True


class PlayedSession:
    """Takes `cost_s` for a frame."""

    def __init__(self, clock: Clock, cost_s: float = 0.0) -> None:
        self.clock = clock
        self.cost_s = cost_s
        self.numbers: list[int] = []

    def step(self, frame: MarkerFrame) -> PoseFrame:
        self.clock.now += self.cost_s
        self.numbers.append(frame.number)
        none = np.empty(0, dtype=np.int64)
        return PoseFrame(
            frame.number, frame.time_s, np.zeros((29, 4)), np.zeros(3), 0.5, np.zeros((0, 3)), none, none, 0.0
        )


def frames(numbers: Sequence[int], stamp: float = 100.0) -> list[bytes]:
    return [encode_frame(stamp, MarkerFrame(number, number / 60)) for number in numbers]


def a_run(cost_s: float = 0.0) -> tuple[CaptureRun, PlayedWorker, PlayedSession, Clock]:
    clock = Clock()
    worker, session = PlayedWorker(), PlayedSession(clock, cost_s)
    return CaptureRun(worker, session, clock), worker, session, clock


def test_every_frame_is_solved_in_order_and_the_newest_is_shown() -> None:
    run, worker, session, clock = a_run()
    assert run.tick() is None
    assert run.phase is Phase.STARTING
    worker.say(*frames([0, 1, 2]))
    newest = run.tick()
    assert newest is not None
    assert newest.number == 2
    assert run.phase is Phase.RUNNING
    assert session.numbers == [0, 1, 2]
    clock.now += 0.012
    run.shown()
    assert run.statistics.latency_s == pytest.approx(0.012)
    assert run.tick() is None  # nothing new: nothing to show


def test_a_backlog_is_solved_in_slices_and_nothing_is_lost() -> None:
    run, worker, session, _ = a_run(cost_s=0.03)
    worker.say(*frames(range(50)))
    ticks = 0
    while len(run.poses) < 50:
        run.tick()
        ticks += 1
        assert ticks <= 50
        if ticks == 1:
            assert run.behind == 46  # four of 30 ms until 100 ms are over
    assert session.numbers == list(range(50))


def test_solving_keeps_pace_with_a_viewport_that_draws_slowly() -> None:
    run, worker, session, clock = a_run(cost_s=0.01)
    number = 0
    for _ in range(20):
        arrived = range(number, number + 24)
        number += 24
        worker.say(*frames(arrived))
        clock.now += 0.3  # a redraw
        run.tick()
        assert run.behind == 0
    assert session.numbers == list(range(number))


def test_stop_solves_what_still_comes() -> None:
    run, worker, _, _ = a_run()
    worker.say(*frames([0, 1]))
    run.tick()
    run.stop()
    assert worker.asked_to_stop
    assert run.phase is Phase.FINISHING
    run.tick()
    assert run.phase is Phase.FINISHING  # the worker has not said that nothing follows
    worker.say(*frames([2, 3]), encode_json(MessageKind.END, {"frames": 4}))
    run.tick()
    assert run.phase is Phase.DONE
    assert [pose.number for pose in run.poses] == [0, 1, 2, 3]
    assert run.statistics.announced == run.statistics.received == 4


def test_a_worker_that_does_not_stop_is_not_waited_for_forever() -> None:
    run, worker, _, clock = a_run()
    worker.say(*frames([0]))
    run.tick()
    run.stop()
    clock.now += STOP_LIMIT_S + 1
    run.tick()
    assert run.phase is Phase.DONE
    assert len(run.poses) == 1


def test_the_end_of_a_video_ends_the_capture() -> None:
    run, worker, _, _ = a_run()
    worker.say(*frames([0, 1]), encode(MessageKind.END))
    run.tick()
    assert run.phase is Phase.DONE
    assert run.error is None
    assert len(run.poses) == 2


def test_an_error_keeps_what_was_captured() -> None:
    run, worker, _, _ = a_run()
    error = encode_json(MessageKind.ERROR, {"what": "froze", "where": "camera 1", "advice": "plug it in again"})
    worker.say(*frames([0, 1, 2]), error)
    run.tick()
    assert run.phase is Phase.DONE
    assert len(run.poses) == 3
    assert str(run.error) == "camera 1: froze; plug it in again"


def test_a_dead_worker_ends_the_capture() -> None:
    run, worker, _, _ = a_run()
    worker.say(*frames([0]))
    run.tick()
    worker.failure = CaptureError("ended by itself")
    run.tick()
    assert run.phase is Phase.DONE
    assert run.error is worker.failure
    assert len(run.poses) == 1


def test_dropped_frames_and_silence_are_told() -> None:
    run, worker, _, clock = a_run()
    worker.say(*frames([0, 1, 4, 5, 9]))
    run.tick()
    assert run.statistics.lost == 5
    assert run.notice == ""
    clock.now += 3.0
    run.tick()
    assert run.notice == "no images for 3 s"


def test_what_the_worker_does_is_told_until_frames_come() -> None:
    run, worker, _, _ = a_run()
    worker.say(encode_json(MessageKind.STATUS, {"activity": "learning the background", "fraction": 0.25}))
    run.tick()
    assert (run.activity, run.fraction) == ("learning the background", 0.25)
    worker.say(encode_json(MessageKind.WARNING, {"text": "camera 1 is darker than at calibration"}))
    run.tick()
    assert run.notice == "camera 1 is darker than at calibration"


def test_the_rate_is_that_of_the_last_second() -> None:
    run, worker, _, clock = a_run()
    for number in range(180):
        worker.say(*frames([number]))
        clock.now += 1 / 60
        run.tick()
    assert run.statistics.frames_per_s == pytest.approx(60, abs=1.5)
