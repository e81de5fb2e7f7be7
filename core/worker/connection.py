"""Blender's end of the loopback connection to one worker process.

It is a plain socket, because sockets can be read without blocking on Linux, macOS and Windows.
`multiprocessing.connection` cannot: `accept` blocks in its handshake with any program that connects, and `recv_bytes`
blocks once part of a message has arrived, so a worker that hangs while sending a picture would freeze Blender's window.
"""

import hmac
import secrets
import select
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any

from ..errors import CaptureError
from .protocol import MAGIC, Decoder, Message, MessageKind, encode_json
from .worker_settings import WORKER

_CHUNK = 1 << 16  # bytes received in one call


class WorkerConnection:
    """Listening socket that serves the one program that sends the right token; only `wait` blocks.

    Args:
        request: Request of the job, sent once the worker is connected; it may change until then.
    """

    def __init__(self, request: Mapping[str, Any]) -> None:
        self.token = secrets.token_hex(16)
        self.is_authenticated = False  # stays True after the worker has closed the connection
        self.fault = ""  # the system's error that ended the connection, if there was one
        self._request = request
        self._decoder = Decoder()
        self._outgoing = bytearray()
        self._socket: socket.socket | None = None
        self._accepted_s = 0.0
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=4)
        self._listener.setblocking(False)

    @property
    def port(self) -> int:
        """Port that the worker connects to."""
        return int(self._listener.getsockname()[1])

    @property
    def is_open(self) -> bool:
        """Whether a program is connected, from which messages may still arrive."""
        return self._socket is not None

    def receive(self) -> list[Message]:
        """Return complete messages that have arrived, a limited number per call.

        Raises:
            CaptureError: The stream is damaged or of another version.
        """
        if not self.is_authenticated:
            self._accept()
        messages: list[Message] = []
        received = 0
        while self._socket is not None and received < WORKER.poll_bytes and len(messages) < WORKER.poll_messages:
            try:
                data = self._socket.recv(_CHUNK)
            except BlockingIOError:
                break
            except OSError as error:
                data, self.fault = b"", str(error.strerror)
            is_stranger = not self.is_authenticated and not received and not data.startswith(MAGIC)
            if not data or is_stranger:
                self.disconnect()
                break
            received += len(data)
            messages += self._decoder.feed(data)
        if messages and not self.is_authenticated:
            messages = self._authenticate(messages)
        return messages

    def _accept(self) -> None:
        """Accept the next program, unless the connected one still has time to send its token."""
        now_s = time.monotonic()
        if self._socket is not None and now_s - self._accepted_s < WORKER.greeting_s:
            return
        try:
            connection, _ = self._listener.accept()
        except BlockingIOError:
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.disconnect()
        self._decoder = Decoder()
        self._socket, self._accepted_s = connection, now_s

    def _authenticate(self, messages: Sequence[Message]) -> list[Message]:
        """Return the messages after HELLO; disconnect a program that sends the wrong token."""
        hello = messages[0]
        try:
            token = str(hello.json().get("token", "")) if hello.kind is MessageKind.HELLO else ""
        except CaptureError:
            token = ""
        if not hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode()):
            self.disconnect()
            self._decoder = Decoder()
            return []
        self.is_authenticated = True
        self._listener.close()
        self._outgoing += encode_json(MessageKind.REQUEST, self._request)
        return list(messages[1:])

    def send(self, data: bytes = b"") -> None:
        """Queue bytes, and send as much of the queue as the system accepts now."""
        self._outgoing += data
        if not self._outgoing or self._socket is None or not self.is_authenticated:
            return
        try:
            sent = self._socket.send(self._outgoing)
        except (BlockingIOError, ConnectionError):
            return  # `receive` notices the lost connection
        del self._outgoing[:sent]

    def wait(self, limit_s: float) -> None:
        """Return when there is something to receive, or after `limit_s`."""
        if self._socket is not None:
            select.select([self._socket], [], [], limit_s)
        elif not self.is_authenticated:
            select.select([self._listener], [], [], limit_s)
        else:  # the connection is lost; the next poll says why
            time.sleep(limit_s)

    def disconnect(self) -> None:
        """Close the connection, which also ends the worker."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def close(self) -> None:
        """Close the connection and release the port; safe to call twice."""
        self._listener.close()
        self.disconnect()
