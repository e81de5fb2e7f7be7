"""Blender's side of the worker: starts the process, collects its messages without waiting, ends it.

The two processes talk over a loopback socket, the one channel that can be read without waiting on Linux, macOS and
Windows alike; a random token keeps other programs of the machine out. No thread is used on this side. The worker
queues what Blender is too slow to take, so nothing is lost and nobody blocks.
"""

import contextlib
import hmac
import importlib.util
import json
import os
import secrets
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from ..errors import CaptureError
from .protocol import Decoder, Message, MessageKind, encode, encode_json

START_LIMIT_S = 60.0
SILENCE_LIMIT_S = 15.0
_CHUNK = 1 << 20
_DYING_S = 1.0  # from a closed standard input to the end of a process
_LIBRARIES = ("numpy", "scipy", "cv2", "ezc3d")


def library_paths() -> list[str]:
    """Return the folders from which this process imports its libraries, so that the worker takes the same ones."""
    folders: list[str] = []
    for name in _LIBRARIES:
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

    Args:
        request: the job, JSON-able (see `process`).
        python: the interpreter; never Blender's own binary.

    Raises:
        CaptureError: the process could not be started.
    """

    def __init__(self, request: Mapping[str, Any], python: str | None = None) -> None:
        self._request = dict(request)
        self._token = secrets.token_hex(16)
        self._decoder = Decoder()
        self._connection: socket.socket | None = None
        self._outgoing = bytearray()
        self._authenticated = False
        self._ended = False
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 (closed in _release)
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=4)
        self._listener.setblocking(False)
        self._last_heard = self._started = time.monotonic()
        program = python or sys.executable
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
        script = Path(__file__).with_name("bootstrap.py")
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        return subprocess.Popen(
            [python, "-I", str(script)],
            stdin=subprocess.PIPE,
            stdout=self._log,
            stderr=self._log,
            env=environment,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )

    def _send_start(self) -> None:
        start = {
            "root": str(Path(__file__).resolve().parents[2]),
            "paths": library_paths(),
            "port": self._listener.getsockname()[1],
            "token": self._token,
        }
        if self._process.stdin is not None:
            self._process.stdin.write(json.dumps(start).encode("utf-8") + b"\n")
            self._process.stdin.flush()

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
            CaptureError: the worker died, fell silent, or spoke nonsense.
        """
        if self._ended:
            return []
        if self._connection is None and not self._authenticated:
            self._accept()
        messages = self._receive() if self._connection is not None else []
        self._send_pending()
        now = time.monotonic()
        if messages:
            self._last_heard = now
        elif not self.running:
            messages = self._receive() if self._connection is not None else []
            if not messages:
                raise self._death()
        elif now - self._last_heard > (SILENCE_LIMIT_S if self._authenticated else START_LIMIT_S):
            raise CaptureError(
                f"has said nothing for {now - self._last_heard:.0f} s", where="worker", advice="start again"
            )
        self._ended = any(message.kind is MessageKind.END for message in messages)
        return messages

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
        """Tell the worker how many frames have been dealt with in all."""
        self._outgoing += encode_json(MessageKind.TAKEN, {"frames": frames})
        self._send_pending()

    def request_stop(self) -> None:
        """Ask the worker to end cleanly; go on calling `poll` until `ended`."""
        self._outgoing += encode(MessageKind.STOP)
        self._send_pending()

    def close(self, grace_s: float = 1.0) -> None:
        """End the process, kindly first, and free everything; safe to call twice."""
        self._listener.close()
        self._drop_connection()  # the worker ends when this closes
        self._end_process(grace_s)
        self._ended = True
        self._release()

    def _end_process(self, grace_s: float) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):  # what a process that is gone has not read is still in its buffer
                self._process.stdin.close()
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
