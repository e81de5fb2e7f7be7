"""What stands in the cameras' place where trackers come by VMC: what it hands over, and what it tells."""

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.formats.vmc import frame_assembler
from perfanim.core.formats.vmc.frame_assembler import FloodLimits
from perfanim.core.formats.vmc.vmc_packets import BONE
from perfanim.core.formats.vmc.vmc_udp import Receiver
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.worker.jobs import tracker_frames
from perfanim.core.worker.requests import TrackerSource, TrackersRequest
from perfanim.core.worker.restart_point import RestartPoint
from perfanim.core.worker.worker_settings import WorkerSettings
from trackers_sent import Program, free_port, tracker_packet

PATIENCE_S = 60.0
HASTY = WorkerSettings(silent_trackers_s=0.4)
MARKER_SET = load_marker_set("boxing")
NAMES = MARKER_SET.names
AFTER = RestartPoint(7, 0.1, 5.0)


class Blender:
    """Takes the place of the channel."""

    def __init__(self) -> None:
        self.stop_requested = threading.Event()
        self.received: list[tuple[float, MarkerFrame]] = []
        self.acknowledged = 0
        self.told: list[str] = []

    @property
    def frames(self) -> int:
        return len(self.received)

    def send_frame(self, stamp_s: float, frame: MarkerFrame) -> None:
        self.received.append((stamp_s, frame))

    def send_warning(self, text: str, standing: bool = False) -> None:
        self.told.append(text)

    def send_status(self, text: str) -> None:
        self.told.append(text)


class Running:
    """The job in a thread of its own."""

    def __init__(self, sender: str = "127.0.0.1") -> None:
        self.port, self.blender = free_port(), Blender()
        request = TrackersRequest(source=TrackerSource(self.port, sender=sender), marker_set=MARKER_SET)
        self._thread = threading.Thread(target=tracker_frames.run, args=(request, self.blender))

    def __enter__(self) -> "Running":
        self._thread.start()
        self.until(lambda: bool(self.blender.told))
        return self

    def __exit__(self, *_: object) -> None:
        self.blender.stop_requested.set()
        self._thread.join()

    def until(self, condition: Callable[[], bool], send: Callable[[], None] = lambda: None) -> None:
        limit_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < limit_s, self.blender.told
            send()
            time.sleep(1 / 60)

    def until_told(self, text: str, send: Callable[[], None] = lambda: None) -> None:
        self.until(lambda: text in self.blender.told[-1], send)


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracker_frames, "WORKER", HASTY)


def test_each_reason_why_no_markers_come_is_told_and_that_they_are_back() -> None:
    places = {name: (0.1 * at, 1.0, 0.0) for at, name in enumerate(NAMES)}
    with Running() as job, Program(job.port) as program:
        where = f"on port {job.port} from 127.0.0.1"
        job.until_told(f"nothing arrives {where}: let the other program send")
        job.until_told("is not VMC", lambda: program.send(b"GET / HTTP/1.1"))
        job.until_told("not only bones", lambda: program.send(tracker_packet({"Hips": (0, 1, 0)}, address=BONE)))
        job.until_told("named like the trackers LHR-7", lambda: program.send(tracker_packet({"LHR-7": (0, 1, 0)})))
        assert not job.blender.received
        job.until(lambda: len(job.blender.received) > 5, lambda: program.send(tracker_packet(places)))
        job.until_told(f"trackers no longer arrive {where}")
        number = job.blender.received[-1][1].number
        job.until_told("the trackers are back after", lambda: program.send(tracker_packet(places)))
        assert job.blender.told[-2] == ""  # what stood until then
        job.until_told("trackers no longer arrive")
    assert job.blender.told[0] == f"waiting for trackers on port {job.port}"
    assert job.blender.told[5] == ""  # taken back with the first markers
    assert len(job.blender.told) == 10  # each once, not each time that it is looked at
    stamps, frames = zip(*job.blender.received, strict=True)
    assert list(stamps) == sorted(stamps)
    after = next(frame for frame in frames if frame.number > number)
    assert after.number > number + 5  # the pause is seen in the numbers
    for frame in frames:
        np.testing.assert_allclose(frame.points_m[np.argsort(frame.labels)], list(places.values()), atol=1e-6)


def test_others_than_the_sender_are_not_listened_to() -> None:
    with Running("192.0.2.7") as job, Program(job.port) as program:
        job.until_told("only from 127.0.0.1: choose the sender", lambda: program.send(tracker_packet({"A": (0, 1, 0)})))
        assert not job.blender.received


def test_a_port_that_is_taken_and_a_sender_that_is_not_known_are_told() -> None:
    blender = Blender()
    with Receiver(0, "127.0.0.1") as other:
        taken = TrackersRequest(source=TrackerSource(other.port), marker_set=MARKER_SET)
        with pytest.raises(CaptureError, match=f"port {other.port}: cannot be opened .* choose another port"):
            tracker_frames.run(taken, blender)
        # who takes the place of a process that has not given it back yet waits for it, while it is wanted
        blender.stop_requested.set()
        with pytest.raises(CaptureError):
            tracker_frames.run(replace(taken, after=AFTER), blender)
        blender.stop_requested.clear()
        threading.Timer(0.2, other._socket.close).start()
        threading.Timer(0.5, blender.stop_requested.set).start()
        tracker_frames.run(replace(taken, after=AFTER), blender)
    assert blender.told[0] == f"waiting for trackers on port {other.port}"
    unknown = TrackersRequest(source=TrackerSource(0, sender="no such computer"), marker_set=MARKER_SET)
    with pytest.raises(CaptureError, match="no such computer: cannot be resolved"):
        tracker_frames.run(unknown, blender)


def test_a_flood_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_assembler, "LIMITS", FloodLimits(packets=2))
    told = "too many packets arrive"
    with Running() as job, Program(job.port) as program:
        job.until(lambda: any(told in text for text in job.blender.told), lambda: program.send(b"junk"))
        for _ in range(10):
            program.send(b"junk")
        job.until_told("is not VMC", lambda: program.send(b"junk"))
    assert sum(told in text for text in job.blender.told) == 1


def test_the_frames_of_a_flood_do_not_pile_up_and_its_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_assembler, "LIMITS", FloodLimits(frames=80))  # more than the queue of the solver holds
    monkeypatch.setattr(tracker_frames, "WORKER", replace(HASTY, flood_s=2.0))
    with Running() as job, Program(job.port) as program:
        sent = 0

        def send() -> None:
            nonlocal sent
            for _ in range(20):
                program.send(tracker_packet({NAMES[0]: (0.1, 1.0, 0.0)}))
                sent += 1

        job.until(lambda: any("too many packets arrive" in text for text in job.blender.told), send)
        for _ in range(200):  # nothing is acknowledged: for more than a second none of these has room
            send()
            time.sleep(0.01)
        assert len(job.blender.received) <= 80
        job.until(lambda: any("were dropped" in text for text in job.blender.told))
        left_out = sum(int(text.split()[0]) for text in job.blender.told if "were dropped" in text)
        assert left_out + len(job.blender.received) == sent
        before = len(job.blender.received)
        program.send(tracker_packet({NAMES[0]: (0.1, 1.0, 0.0)}))
        job.until(lambda: len(job.blender.received) > before)  # others' frames wait, however many


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell")
def test_packets_that_found_no_room_are_counted() -> None:
    with Receiver(0, "127.0.0.1") as receiver, Program(receiver.port) as program:
        sent, read = 20_000, 0
        for _ in range(sent):
            program.send(bytes(1000))
        while receiver.receive(0.0) is not None:
            read += 1
        assert receiver.overflowed == 0  # the first that found room came before all that did not
        program.send(b"one more")
        assert receiver.receive(1.0) == b"one more"
        assert receiver.overflowed == sent - read > 0
