"""The worker's end of the connection to Blender.

One thread sends from an unlimited queue, so that cameras never lose frames because Blender is slow; another receives.
"""

import faulthandler
import math
import os
import queue
import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from ..errors import CaptureError, PerfanimError
from ..geometry.arrays import Image
from ..markers.marker_frame import MarkerFrame
from ..system.schema import table_of
from ..system.slowness import Slowness
from .job_status import JobStatus
from .protocol import Decoder, Message, MessageKind, encode, encode_frame, encode_json, encode_preview
from .worker_settings import WORKER

_Source = TypeVar("_Source")


class Stopped(Exception):  # noqa: N818 - not an error
    """A stop was requested before the work was done; there is no result."""


def open_when_free(open_source: Callable[[], _Source], takes_place: bool, stop: threading.Event) -> _Source:
    """Open cameras or a port; if this process replaces another (`takes_place`), retry while that one may hold them."""
    limit_s = time.monotonic() + (WORKER.freed_s if takes_place else 0.0)
    while True:
        try:
            return open_source()
        except CaptureError:
            if time.monotonic() > limit_s or stop.wait(WORKER.retry_s):
                raise


class Channel:
    """Connection to Blender.

    Sending never blocks. `stop_requested` is set by a STOP message, or when Blender ends.

    Attributes:
        disconnected: Set once Blender has closed the connection or died.
        frames: Frames or poses sent.
        acknowledged: Frames or poses that Blender has processed.
        progress_s: `time.monotonic()` of the job's last progress; None if the job does not report progress.
        final: Contents of the END message.
    """

    def __init__(self, port: int, token: str) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=30)
        self._socket.settimeout(None)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._requests: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self.stop_requested = threading.Event()
        self.disconnected = threading.Event()
        self._state_changed = threading.Condition()  # guards `acknowledged` and `stop_requested`
        self.activity = "starting"
        self.slowness = Slowness()
        self.frames = 0
        self.acknowledged = 0
        self.final: dict[str, Any] = {}
        self.progress_s: float | None = None
        self._filter_settings: dict[str, Any] | None = None
        self._times = WORKER  # kept, because tests change WORKER and these threads outlive them
        self._socket.sendall(encode_json(MessageKind.HELLO, {"token": token, "process": os.getpid()}))
        self._sender = threading.Thread(target=self._send_loop, name="send")
        self._sender.start()
        threading.Thread(target=self._receive_loop, name="receive", daemon=True).start()

    def wait_request(self) -> dict[str, Any]:
        """Wait for the job's request."""
        return self._requests.get().json()

    def newest_request(self) -> dict[str, Any]:
        """Wait for further requests; return the newest, or {} if Blender is gone."""
        message = self._requests.get()
        while not self._requests.empty():
            message = self._requests.get()
        return message.json()

    @property
    def has_request(self) -> bool:
        """Whether a further request is waiting."""
        return not self._requests.empty()

    def wait_for_ack(self, in_flight: int, limit_s: float | None = None) -> None:
        """Wait until at most `in_flight` frames are not acknowledged, a stop is requested, or `limit_s` has passed.

        This sleeps until a message arrives: polling every millisecond would take a tenth of the CPU time that Blender
        needs.
        """
        with self._state_changed:
            self._state_changed.wait_for(
                lambda: self.frames - self.acknowledged <= in_flight or self.stop_requested.is_set(), timeout=limit_s
            )

    def take_filter_settings(self) -> dict[str, Any] | None:
        """Return the settings of a new FILTER message, or None."""
        settings, self._filter_settings = self._filter_settings, None
        return settings

    def send_frame(self, stamp_s: float, frame: MarkerFrame) -> None:
        """Send a marker frame; `stamp_s` is `time.perf_counter()` at the arrival of its images."""
        self.frames += 1
        self._queue.put(encode_frame(stamp_s, frame))

    def send_pose(self, record: bytes) -> None:
        """Send a pose packed by `pose_codec`."""
        self.frames += 1
        self._queue.put(encode(MessageKind.POSE, record))

    def send_preview(self, picture: Image) -> None:
        """Send a picture (height, width, 3), RGB."""
        self._queue.put(encode_preview(picture))

    def send_status(self, activity: str, fraction: float | None = None, **details: Any) -> None:
        """Send the current activity and the fraction done, if known; `details` are further fields of `JobStatus`."""
        self.activity = activity
        queued = self._queue.qsize()
        status = JobStatus(activity, fraction, frames=self.frames, queued=queued, **details)
        self._queue.put(encode_json(MessageKind.STATUS, table_of(status)))

    def send_warning(self, text: str, standing: bool = False) -> None:
        """Send a warning; a `standing` one stays until the next standing warning, and "" withdraws it."""
        self._queue.put(encode_json(MessageKind.WARNING, {"text": text, "standing": standing}))

    def send_result(self, summary: Mapping[str, Any]) -> None:
        """Send the result of a job."""
        self._queue.put(encode_json(MessageKind.RESULT, summary))

    def send_error(self, error: PerfanimError) -> None:
        """Send an error."""
        content = {"what": error.what, "where": error.where, "advice": error.advice}
        self._queue.put(encode_json(MessageKind.ERROR, content))

    def close(self) -> None:
        """Send END, wait until everything is sent, and close the connection."""
        self._queue.put(encode_json(MessageKind.END, {"frames": self.frames, **self.final}))
        self._queue.put(None)
        self._sender.join()
        self._socket.close()

    def _send_loop(self) -> None:
        beat_s = -math.inf
        while True:
            is_due = time.monotonic() - beat_s > self._times.heartbeat_s
            if is_due:
                # a library that never releases the interpreter would keep the process alive forever
                faulthandler.dump_traceback_later(self._times.blocked_s, exit=True)
                beat_s = time.monotonic()
            try:
                data = self._queue.get(timeout=self._times.heartbeat_s)
            except queue.Empty:
                data, is_due = b"", True
            if data is None:
                faulthandler.cancel_dump_traceback_later()
                return
            if is_due:
                data = self._heartbeat() + data  # END remains the last message
            try:
                self._socket.sendall(data)
            except OSError:  # Blender is gone
                self._request_stop()
                return

    def _heartbeat(self) -> bytes:
        stalled_s = 0.0 if self.progress_s is None else time.monotonic() - self.progress_s
        return encode_json(MessageKind.STATUS, table_of(JobStatus(stalled_s=stalled_s, slowness=self.slowness.factor)))

    def _request_stop(self) -> None:
        with self._state_changed:
            self.stop_requested.set()
            self._state_changed.notify_all()

    def _receive(self, message: Message) -> None:
        if message.kind is MessageKind.STOP:
            self._request_stop()
        elif message.kind is MessageKind.ACK:
            with self._state_changed:
                self.acknowledged = max(message.count("frames"), 0)
                self._state_changed.notify_all()
        elif message.kind is MessageKind.FILTER:
            self._filter_settings = message.json()
        else:
            self._requests.put(message)

    def _receive_loop(self) -> None:
        decoder = Decoder()
        while True:
            try:
                data = self._socket.recv(1 << 16)
            except OSError:
                data = b""
            if not data:
                break
            try:
                for message in decoder.feed(data):
                    self._receive(message)
            except PerfanimError:  # the stream cannot be read from here on
                break
        # a job that does not end by itself would be left behind as an orphan
        self.disconnected.set()
        self._request_stop()
        self._requests.put(Message(MessageKind.REQUEST))
        time.sleep(self._times.grace_s)
        os._exit(3)
