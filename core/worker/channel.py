"""The worker's side of the loopback connection.

Sending goes through a queue without limit and a thread of its own, so that a slow Blender never makes a camera lose
frames; receiving has a thread too. These threads live in the worker process, never in Blender.
"""

import faulthandler
import math
import os
import queue
import socket
import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import PerfanimError
from ..markers.marker_frame import MarkerFrame
from .protocol import Decoder, Message, MessageKind, encode, encode_frame, encode_json, encode_preview

HEARTBEAT_S = 0.5
_PARENT_GONE_GRACE_S = 3.0
_BLOCKED_S = 20.0  # without any Python run: longer than anybody waits for a sign of life


class Channel:
    """Connection to Blender.

    `send_*` never waits; `stop_requested` is set by a STOP message, or when Blender is gone.
    """

    def __init__(self, port: int, token: str) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=30)
        self._socket.settimeout(None)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._requests: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self.stop_requested = threading.Event()
        self.gone = threading.Event()  # Blender has closed the connection, or died: nobody reads what is sent
        self._news = threading.Condition()  # of `taken` or `stop_requested`
        self.activity = "starting"
        self.frames = 0
        self.taken = 0  # frames that the receiver says it is done with
        self.tuned: dict[str, Any] | None = None  # by the last TUNE message; who heeds it sets None
        self.final: dict[str, Any] = {}  # goes into END
        self.alive_s: float | None = None  # `time.monotonic()` of a job's last sign of getting on, where it gives any
        self._queue.put(encode_json(MessageKind.HELLO, {"token": token, "process": os.getpid()}))
        self._sender = threading.Thread(target=self._send_loop, name="send")
        self._sender.start()
        threading.Thread(target=self._receive_loop, name="receive", daemon=True).start()

    def wait_request(self) -> dict[str, Any]:
        """Return the job that Blender asks for."""
        return self._requests.get().json()

    def wait_taken(self, in_flight: int, limit_s: float | None = None) -> None:
        """Wait until at most `in_flight` frames are on their way, a stop is asked for, or `limit_s` has passed.

        Sleeps until word comes: looking every millisecond takes a tenth of what Blender has for drawing.
        """
        with self._news:
            self._news.wait_for(
                lambda: self.frames - self.taken <= in_flight or self.stop_requested.is_set(), timeout=limit_s
            )

    @property
    def queued(self) -> int:
        """Messages that Blender has not taken yet (those in the socket's own buffer not counted)."""
        return self._queue.qsize()

    def send_frame(self, stamp_s: float, frame: MarkerFrame) -> None:
        """Hand a marker frame over; `stamp_s` = `time.perf_counter()` when its images were in hand."""
        self.frames += 1
        self._queue.put(encode_frame(stamp_s, frame))

    def send_pose(self, record: bytes) -> None:
        """Hand a solved pose over (`pose_bytes.pack_solved`)."""
        self.frames += 1
        self._queue.put(encode(MessageKind.POSE, record))

    def send_preview(self, picture: NDArray[np.uint8]) -> None:
        """Hand over a picture (height, width, 3), RGB, to be shown."""
        self._queue.put(encode_preview(picture))

    def send_status(self, activity: str, fraction: float | None = None, **details: Any) -> None:
        """Say what is being done; `fraction` of the work done where that is known."""
        self.activity = activity
        content = {"activity": activity, "fraction": fraction, "frames": self.frames, "queued": self.queued}
        self._queue.put(encode_json(MessageKind.STATUS, {**content, **details}))

    def send_warning(self, text: str, standing: bool = False) -> None:
        """Tell the user something that does not end the job; what is `standing` holds until the next that is, or ""."""
        self._queue.put(encode_json(MessageKind.WARNING, {"text": text, "standing": standing}))

    def send_result(self, summary: Mapping[str, Any]) -> None:
        """Hand over the result of a job."""
        self._queue.put(encode_json(MessageKind.RESULT, summary))

    def send_error(self, error: PerfanimError) -> None:
        """Hand over an error."""
        content = {"what": error.what, "where": error.where, "advice": error.advice}
        self._queue.put(encode_json(MessageKind.ERROR, content))

    def close(self) -> None:
        """Say that nothing follows, wait until all is sent, close."""
        self._queue.put(encode_json(MessageKind.END, {"frames": self.frames, **self.final}))
        self._queue.put(None)
        self._sender.join()
        self._socket.close()

    def _send_loop(self) -> None:
        armed_s = -math.inf
        while True:
            if time.monotonic() - armed_s > HEARTBEAT_S:
                # a library that never gives the interpreter back would keep the process alive for ever
                faulthandler.dump_traceback_later(_BLOCKED_S, exit=True)
                armed_s = time.monotonic()
            try:
                data = self._queue.get(timeout=HEARTBEAT_S)
            except queue.Empty:
                stalled_s = 0.0 if self.alive_s is None else time.monotonic() - self.alive_s
                content = {"activity": self.activity, "frames": self.frames, "queued": 0, "stalled_s": stalled_s}
                data = encode_json(MessageKind.STATUS, content)
            if data is None:
                faulthandler.cancel_dump_traceback_later()
                return
            try:
                self._socket.sendall(data)
            except OSError:  # Blender is gone: what is queued has no reader
                self._request_stop()
                return

    def _request_stop(self) -> None:
        with self._news:
            self.stop_requested.set()
            self._news.notify_all()

    def _receive_loop(self) -> None:
        decoder = Decoder()
        while True:
            try:
                data = self._socket.recv(1 << 16)
            except OSError:
                data = b""
            if not data:
                break
            for message in decoder.feed(data):
                if message.kind is MessageKind.STOP:
                    self._request_stop()
                elif message.kind is MessageKind.TAKEN:
                    with self._news:
                        self.taken = int(message.json().get("frames", 0))
                        self._news.notify_all()
                elif message.kind is MessageKind.TUNE:
                    self.tuned = message.json()
                else:
                    self._requests.put(message)
        # A job that does not end by itself now must not stay as an orphan.
        self.gone.set()
        self._request_stop()
        self._requests.put(Message(MessageKind.REQUEST))
        time.sleep(_PARENT_GONE_GRACE_S)
        os._exit(3)
