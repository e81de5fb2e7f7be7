"""The worker's end of the connection, whatever comes in from Blender's end."""

import socket
from collections.abc import Iterator

import pytest
from perfanim.core.worker import channel as channel_module
from perfanim.core.worker.channel import Channel
from perfanim.core.worker.protocol import MAGIC, MessageKind, encode, encode_json
from perfanim.core.worker.worker_settings import WorkerSettings

PATIENCE_S = 30.0


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Channel, socket.socket]]:
    """A channel, and the socket of its parent."""
    # then it ends its process, which is that of tests
    monkeypatch.setattr(channel_module, "WORKER", WorkerSettings(grace_s=1e6))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        channel = Channel(listener.getsockname()[1], "token")
        parent, _ = listener.accept()
        with parent:
            yield channel, parent
            parent.shutdown(socket.SHUT_RDWR)
            channel.close()


GARBAGE = {
    "text": b"GET / HTTP/1.1\r\n\r\n" * 4,
    "no kind": MAGIC + bytes(range(64)),
    "ack of text": encode(MessageKind.ACK, b"no json"),
    "ack of a list": encode(MessageKind.ACK, b"[1]"),
    "deep filter": encode(MessageKind.FILTER, b"[" * 100_000),
}


@pytest.mark.parametrize("garbage", GARBAGE.values(), ids=GARBAGE)
def test_after_garbage_from_the_parent_a_worker_stops(ends: tuple[Channel, socket.socket], garbage: bytes) -> None:
    channel, parent = ends
    parent.sendall(encode_json(MessageKind.REQUEST, {"job": "test"}))
    assert channel.wait_request() == {"job": "test"}
    parent.sendall(garbage + encode(MessageKind.STOP))
    assert channel.stop_requested.wait(PATIENCE_S)


@pytest.mark.parametrize("value", ["text", None, [1], {}, float("nan"), 10**400])
def test_a_number_that_is_none_acknowledges_nothing(ends: tuple[Channel, socket.socket], value: object) -> None:
    channel, parent = ends
    parent.sendall(encode_json(MessageKind.ACK, {"frames": value}) + encode_json(MessageKind.REQUEST, {}))
    channel.wait_request()
    assert channel.acknowledged == 0
    assert not channel.stop_requested.is_set()
