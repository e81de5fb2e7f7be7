"""Blender's side of the worker: starts the process, collects its messages without waiting, ends it, or replaces it.

The two processes talk over a loopback socket, the one channel that can be read without waiting on Linux, macOS and
Windows alike; a random token keeps other programs of the machine out. No thread is used on this side. The worker
queues what Blender is too slow to take, so nothing is lost and nobody blocks.
"""

import contextlib
import hmac
import importlib.util
import os
import secrets
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from ..errors import CaptureError
from ..system import helper_process
from ..system.libraries import LIBRARIES
from . import process
from .protocol import Decoder, Message, MessageKind, encode, encode_json

START_LIMIT_S = 60.0
SILENCE_LIMIT_S = 15.0
# Once frames come, a process gives a sign of life every half second (`channel.HEARTBEAT_S`).
HUNG_S = 1.25
MOST_RESTARTS, _RESTARTS_WITHIN_S = 3, 60.0
_LOOKED_AWAY_S = 0.25  # of the time between two polls counts as silence at most: it may be who polls that was held up
_CHUNK = 1 << 20
_BOOTING_S = 0.1
_DYING_S = 1.0  # from a closed standard input to the end of a process


def library_paths() -> list[str]:
    """Return the folders from which this process imports its libraries, so that the worker takes the same ones."""
    folders: list[str] = []
    for name in LIBRARIES:
        spec = importlib.util.find_spec(name)
        for location in (spec.submodule_search_locations or []) if spec else []:
            folder = str(Path(location).parent)
            if folder not in folders:
                folders.append(folder)
    return folders


def _not_started(program: str, reason: str) -> CaptureError:
    advice = "reinstall Blender or set the worker's Python in the preferences"
    return CaptureError(f"could not be started ({reason})", where=program, advice=advice)


class WorkerClient:
    """One worker process with one job.

    A process that has handed over frames or poses and then dies or hangs can be replaced (`may_restart`, `restart`).

    Args:
        request: the job, JSON-able (see `process`).
        python: the interpreter; never Blender's own binary.

    Raises:
        CaptureError: the process could not be started.
    """

    def __init__(self, request: Mapping[str, Any], python: str | None = None) -> None:
        self._request = dict(request)
        self._python = python
        self._frames = 0  # frames and poses handed over, by processes that were replaced as well
        self.earlier_frames = 0  # by those alone
        self._restarts_s: deque[float] = deque(maxlen=MOST_RESTARTS)
        self._stop_asked = False
        self._launch()

    def _launch(self) -> None:
        self._token = secrets.token_hex(16)
        self._decoder = Decoder()
        self._connection: socket.socket | None = None
        self._outgoing = bytearray()
        self._authenticated = False
        self._ended = False
        self._early: list[Message] = []  # came before anybody polled
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 (closed in _release)
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=4)
        self._listener.setblocking(False)
        self._silent_s, self._stalled_s = 0.0, 0.0
        self._polled_s = time.monotonic()
        program = self._python or sys.executable
        try:
            self._process = self._start(program)
        except OSError as error:
            self._release()
            raise _not_started(program, str(error.strerror)) from error
        try:
            self._send_start()
        except OSError as error:  # it ended before it was told what to do
            self._end_process(_DYING_S)
            reason = f"ended at once with status {self._process.returncode}{self._last_line()}"
            self._release()
            raise _not_started(program, reason) from error

    def _start(self, python: str) -> "subprocess.Popen[bytes]":
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        return subprocess.Popen(
            helper_process.command(python),
            stdin=subprocess.PIPE,
            stdout=self._log,
            stderr=self._log,
            env=environment,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )

    def _send_start(self) -> None:
        port = self._listener.getsockname()[1]
        order = helper_process.order(
            process.main, port, self._token, str(self._request.get("job", "")), paths=library_paths()
        )
        if self._process.stdin is not None:
            self._process.stdin.write(order.encode("utf-8") + b"\n")
            self._process.stdin.flush()

    def ask(self, **changes: Any) -> None:
        """Wait until the process takes its request, with these keys changed: it works while this one is busy.

        Raises:
            CaptureError: as `poll`.
        """
        self._request |= changes
        while not self._authenticated:
            self.wait(_BOOTING_S)
            self._early = self.poll()

    @property
    def running(self) -> bool:
        """Whether the process lives."""
        return self._process.poll() is None

    @property
    def ended(self) -> bool:
        """Whether the worker has said that nothing follows."""
        return self._ended

    def poll(self) -> list[Message]:
        """Return all whole messages that have arrived since the last call; never waits.

        Raises:
            CaptureError: the worker died, hangs, or spoke nonsense.
        """
        early, self._early = self._early, []
        if self._ended:
            return early
        if self._connection is None and not self._authenticated:
            self._accept()
        messages = self._receive() if self._connection is not None else []
        self._send_pending()
        now = time.monotonic()
        self._silent_s += min(now - self._polled_s, _LOOKED_AWAY_S)
        self._polled_s = now
        if messages:
            self._silent_s = 0.0
        elif not self.running:
            messages = self._receive() if self._connection is not None else []
            if not messages:
                raise self._death()
        elif self._silent_s > self._patience_s:
            raise CaptureError(f"has said nothing for {self._silent_s:.1f} s", where="worker", advice="start again")
        for message in messages:
            self._heed(message)
        if self._stalled_s > HUNG_S and self._frames > self.earlier_frames:
            raise CaptureError(f"has got no further for {self._stalled_s:.1f} s", where="worker", advice="start again")
        return early + messages

    @property
    def _patience_s(self) -> float:
        if self._frames > self.earlier_frames:
            return HUNG_S
        return SILENCE_LIMIT_S if self._authenticated else START_LIMIT_S

    def _heed(self, message: Message) -> None:
        if message.kind in (MessageKind.FRAME, MessageKind.POSE):
            self._frames += 1
            self._stalled_s = 0.0
        elif message.kind is MessageKind.STATUS:
            self._stalled_s = float(message.json().get("stalled_s", 0.0))
        elif message.kind is MessageKind.END:
            self._ended = True

    @property
    def may_restart(self) -> bool:
        """Whether a worker that died or hangs should be replaced: it has worked, and does not fail again and again."""
        often = len(self._restarts_s) == MOST_RESTARTS
        if often and time.monotonic() - self._restarts_s[0] < _RESTARTS_WITHIN_S:
            return False
        return self._frames > self.earlier_frames and not self._stop_asked

    def restart(self, **changes: Any) -> None:
        """End the process at once and start another for the same job, but for some keys of the request.

        Raises:
            CaptureError: the process could not be started.
        """
        self._restarts_s.append(time.monotonic())
        self._drop_connection()
        self._close_input()
        self._process.kill()  # one that hangs answers to nothing else
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=_DYING_S)
        self._release()
        self.earlier_frames = self._frames
        self._request |= changes
        self._launch()

    def wait(self, limit_s: float) -> None:
        """Return when there is something to poll, or after `limit_s`; for processes without a window to keep alive."""
        if self._connection is not None:
            select.select([self._connection], [], [], limit_s)
        elif not self._authenticated:
            select.select([self._listener], [], [], limit_s)
        else:  # the connection is lost; the next poll tells why
            time.sleep(limit_s)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except BlockingIOError:
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection

    def _receive(self) -> list[Message]:
        messages: list[Message] = []
        while self._connection is not None:
            try:
                data = self._connection.recv(_CHUNK)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self._drop_connection()
                break
            messages += self._decoder.feed(data)
        if not self._authenticated and messages:
            messages = self._authenticate(messages)
        return messages

    def _authenticate(self, messages: Sequence[Message]) -> list[Message]:
        hello = messages[0]
        offered = str(hello.json().get("token", "")) if hello.kind is MessageKind.HELLO else ""
        if not hmac.compare_digest(offered, self._token):
            self._drop_connection()
            self._decoder = Decoder()
            return []
        self._authenticated = True
        self._listener.close()
        self._outgoing += encode_json(MessageKind.REQUEST, self._request)
        return list(messages[1:])

    def _drop_connection(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._connection = None

    def _send_pending(self) -> None:
        if not self._outgoing or self._connection is None:
            return
        try:
            sent = self._connection.send(self._outgoing)
        except (BlockingIOError, ConnectionError):
            return  # a lost connection shows on reading
        del self._outgoing[:sent]

    def _death(self) -> CaptureError:
        status = self._process.poll()
        reason = f"ended by itself (status {status}){self._last_line()}"
        return CaptureError(reason, where="worker", advice="start again")

    def _last_line(self) -> str:
        """Return the last line that the process printed, after a colon; "" when it printed none."""
        self._log.seek(0)
        lines = self._log.read().decode("utf-8", "replace").strip().splitlines()
        return f": {lines[-1]}" if lines else ""

    def confirm_taken(self, frames: int) -> None:
        """Tell the worker how many frames have been dealt with in all, those of its predecessors counted."""
        self._outgoing += encode_json(MessageKind.TAKEN, {"frames": max(frames - self.earlier_frames, 0)})
        self._send_pending()

    def tune(self, shape: Mapping[str, Any]) -> None:
        """Tell the worker, and whichever takes its place, how poses are to be shown from now on."""
        self._request["shape"] = dict(shape)
        if self._authenticated:
            self._outgoing += encode_json(MessageKind.TUNE, shape)
            self._send_pending()

    def request_stop(self) -> None:
        """Ask the worker to end cleanly; go on calling `poll` until `ended`."""
        self._stop_asked = True
        self._outgoing += encode(MessageKind.STOP)
        self._send_pending()

    def close(self, grace_s: float = 1.0) -> None:
        """End the process, kindly first, and free everything; safe to call twice."""
        self._listener.close()
        self._drop_connection()  # the worker ends when this closes
        self._end_process(grace_s)
        self._ended = True
        self._release()

    def _close_input(self) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):  # what a process that is gone has not read is still in its buffer
                self._process.stdin.close()

    def _end_process(self, grace_s: float) -> None:
        self._close_input()
        try:
            self._process.wait(timeout=grace_s)
        except subprocess.TimeoutExpired:
            self._process.terminate()
            try:
                self._process.wait(timeout=grace_s)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _release(self) -> None:
        self._listener.close()
        if not self._log.closed:
            self._log.close()
