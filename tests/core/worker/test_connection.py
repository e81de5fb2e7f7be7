"""Blender's end of the connection, whatever comes in from the other end."""

import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.worker import connection as connection_module
from perfanim.core.worker.connection import WorkerConnection
from perfanim.core.worker.job_status import JobStatus
from perfanim.core.worker.liveness import Liveness
from perfanim.core.worker.protocol import Message, MessageKind, encode, encode_json
from perfanim.core.worker.worker_settings import WORKER, WorkerSettings

PATIENCE_S = 30.0


@pytest.fixture
def blender() -> Iterator[WorkerConnection]:
    connection = WorkerConnection({"job": "test"})
    yield connection
    connection.close()


def connect(blender: WorkerConnection) -> socket.socket:
    return socket.create_connection(("127.0.0.1", blender.port), timeout=PATIENCE_S)


def greet(blender: WorkerConnection) -> socket.socket:
    worker = connect(blender)
    worker.sendall(encode_json(MessageKind.HELLO, {"token": blender.token}))
    wait_until(blender, lambda: blender.is_authenticated)
    return worker


def wait_until(blender: WorkerConnection, done) -> list[Message]:
    messages, limit = [], time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < limit
        messages += blender.receive()
    return messages


@pytest.mark.parametrize(
    "said",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        encode_json(MessageKind.HELLO, {"token": "caf\u00e9 \ud800"}),
        encode_json(MessageKind.HELLO, {"token": ["a"]}),
        encode(MessageKind.HELLO, b"[" * 100_000),
        encode(MessageKind.HELLO, b"no json"),
        encode(MessageKind.STATUS),
    ],
    ids=["http", "no ascii", "list", "deep", "text", "no greeting"],
)
def test_a_stranger_is_dropped_and_the_worker_let_in(blender: WorkerConnection, said: bytes) -> None:
    with connect(blender) as stranger:
        stranger.sendall(said)
        blender.receive()
        stranger.settimeout(0.0)

        def dropped() -> bool:
            try:
                return stranger.recv(1) == b""
            except BlockingIOError:
                return False
            except ConnectionError:
                return True

        wait_until(blender, dropped)
    assert not blender.is_authenticated
    greet(blender).close()


def test_a_stranger_who_says_nothing_keeps_nobody_out(
    blender: WorkerConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    with connect(blender):
        blender.receive()
        with connect(blender) as worker:
            worker.sendall(encode_json(MessageKind.HELLO, {"token": blender.token}))
            blender.receive()
            assert not blender.is_authenticated  # the first may be slow to speak
            monkeypatch.setattr(connection_module, "WORKER", WorkerSettings(greeting_s=0.0))
            wait_until(blender, lambda: blender.is_authenticated)


FLOODS = {"many": encode(MessageKind.STATUS), "long": encode_json(MessageKind.PREVIEW, {"x": "y" * 1_000_000})}


@pytest.mark.parametrize("message", FLOODS.values(), ids=FLOODS)
def test_a_flood_is_taken_in_parts(blender: WorkerConnection, message: bytes) -> None:
    count = max(4_000_000 // len(message), 40)
    with greet(blender) as worker:
        sender = threading.Thread(target=worker.sendall, args=(message * count,))
        sender.start()
        came = 0
        limit = time.monotonic() + PATIENCE_S
        while came < count:
            assert time.monotonic() < limit
            messages = blender.receive()
            assert len(messages) <= WORKER.poll_messages + connection_module._CHUNK // 8
            assert sum(len(each.payload) for each in messages) <= WORKER.poll_bytes + 2_000_000
            came += len(messages)
        assert came == count
        sender.join()


def test_a_long_control_message_is_refused(blender: WorkerConnection) -> None:
    with greet(blender) as worker:
        worker.sendall(encode(MessageKind.STATUS, b" " * 2_000_000)[:1000])
        with pytest.raises(CaptureError, match="invalid message"):
            wait_until(blender, lambda: False)


@pytest.mark.parametrize("value", ["text", [1], {}, float("nan"), float("inf"), 10**400])
@pytest.mark.parametrize("key", ["stalled_s", "slowness", "fraction", "frames"])
def test_a_status_with_anything_but_numbers_is_refused(key: str, value: Any) -> None:
    message = Message(MessageKind.STATUS, encode_json(MessageKind.STATUS, {key: value, "activity": "a"})[8:])
    with pytest.raises(CaptureError, match=f"worker: {key} must be a (whole )?number"):
        Liveness().update([message])
    assert Message(MessageKind.STATUS, b'{"activity": "a", "later": []}').status() == JobStatus("a")


def test_deep_json_is_an_error_of_ours() -> None:
    for payload in (b"[" * 100_000, b'{"a":' * 100_000, b"\xff", b"9" * 10_000):
        with pytest.raises(CaptureError, match="a STATUS message is not JSON"):
            Message(MessageKind.STATUS, payload).json()
