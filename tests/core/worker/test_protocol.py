import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.marker_frame import MarkerFrame
from perfanim.core.worker.protocol import Decoder, Message, MessageKind, encode, encode_frame, encode_json


def a_frame(number: int) -> MarkerFrame:
    rng = np.random.default_rng(number)
    points = rng.normal(size=(5, 3))
    return MarkerFrame(number, number / 60, points, np.tile(np.eye(3) * 1e-6, (5, 1, 1)), notes=("left hand hidden",))


@pytest.mark.parametrize("piece", [1, 7, 64, 10_000])
def test_messages_survive_any_cutting(piece: int) -> None:
    stream = b"".join(
        [
            encode_json(MessageKind.HELLO, {"token": "t", "n": np.int64(4)}),
            *[encode_frame(10.0 + i, a_frame(i)) for i in range(3)],
            encode(MessageKind.END),
        ]
    )
    decoder = Decoder()
    messages: list[Message] = []
    for start in range(0, len(stream), piece):
        messages += decoder.feed(stream[start : start + piece])
    assert [m.kind for m in messages] == [MessageKind.HELLO, *[MessageKind.FRAME] * 3, MessageKind.END]
    assert messages[0].json() == {"token": "t", "n": 4}
    for i, message in enumerate(messages[1:4]):
        stamp, frame = message.frame()
        assert stamp == 10.0 + i
        assert frame.number == i
        assert frame.notes == ("left hand hidden",)
        np.testing.assert_array_equal(frame.points_m, a_frame(i).points_m)


def test_a_damaged_stream_is_refused() -> None:
    good = encode_json(MessageKind.STATUS, {"activity": "x"})
    for position, value in ((0, 0), (2, 99), (3, 77), (7, 255)):
        damaged = bytearray(good)
        damaged[position] = value
        with pytest.raises(CaptureError):
            Decoder().feed(bytes(damaged))


def test_control_messages_must_be_objects() -> None:
    with pytest.raises(CaptureError, match="not JSON"):
        Message(MessageKind.STATUS, b"\xff{").json()
    with pytest.raises(CaptureError, match="not an object"):
        Message(MessageKind.STATUS, b"[1]").json()
    with pytest.raises(CaptureError, match="no marker frame"):
        Message(MessageKind.STATUS, b"12345678").frame()
