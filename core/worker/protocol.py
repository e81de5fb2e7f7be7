"""Messages between Blender and its worker processes, without pickle.

A message consists of a version, a kind, a length and bytes.
Control messages carry JSON. Frames and poses carry the time at which their images arrived (`time.perf_counter`, one
clock for all processes on a machine), which gives the latency.
"""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from ..errors import CaptureError
from ..formats.take_file.pose_codec import TimedPose, unpack_solved
from ..formats.take_file.take_setup import plain
from ..geometry.arrays import Image
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_frame_codec import pack_stamped
from ..system.files import reading
from .job_status import STATUS, JobStatus

VERSION = 1
MAX_PAYLOAD = 64 * 1024 * 1024

_MAX_CONTROL = 1 << 20

_HEADER = struct.Struct("<2sBBI")
_PICTURE = struct.Struct("<HH")  # width, height
MAGIC = b"PA"


class MessageKind(IntEnum):
    """Kinds of messages; the first four are sent to the worker, the others come from it."""

    REQUEST = 1  # JSON: the job
    STOP = 2  # end cleanly after sending the remaining frames
    ACK = 3  # JSON: number of frames that the receiver has processed, so that a source that can wait does not run ahead
    FILTER = 4  # JSON: settings of the pose filter from now on (`session.pose_filters`)
    HELLO = 10  # JSON: token, process id
    STATUS = 11  # JSON: `JobStatus`
    FRAME = 12  # stamp and marker frame
    RESULT = 13  # JSON: summary of the finished job
    ERROR = 14  # JSON: what, where, advice
    WARNING = 15  # JSON: text
    END = 16  # JSON: frames sent; nothing follows
    POSE = 17  # stamp, time in the solver, frames waiting, and pose frame
    PREVIEW = 18  # width, height and RGB bytes of a picture to show, row by row from the top


_LONG_KINDS = (
    MessageKind.REQUEST, MessageKind.FRAME, MessageKind.RESULT, MessageKind.POSE, MessageKind.PREVIEW
)  # fmt: skip


@dataclass(frozen=True)
class Message:
    """One complete message."""

    kind: MessageKind
    payload: bytes = b""

    def json(self) -> dict[str, Any]:
        """Return the JSON object that a control message carries; {} for an empty payload."""
        if not self.payload:
            return {}
        with reading("worker", CaptureError, "start again", f"a {self.kind.name} message is not JSON"):
            value = json.loads(self.payload)
        if not isinstance(value, dict):
            what = f"a {self.kind.name} message is not a JSON object"
            raise CaptureError(what, where="worker", advice="start again")
        return value

    def status(self) -> JobStatus:
        """Return the content of a STATUS message."""
        return STATUS.read(self.json(), "worker")

    def count(self, key: str) -> int:
        """Return a number of frames from an ACK or END message, or -1 if it is missing."""
        value = self.json().get(key)
        return value if isinstance(value, int) and 0 <= value < 1 << 53 else -1

    def error(self) -> CaptureError:
        """Return the error from an ERROR message."""
        content = {key: str(value) for key, value in self.json().items()}
        return CaptureError(
            content.get("what", "failed"), where=content.get("where", ""), advice=content.get("advice", "")
        )

    def pose(self) -> TimedPose:
        """Return the pose from a POSE message."""
        if self.kind is not MessageKind.POSE:
            raise CaptureError(f"a {self.kind.name} message holds no pose", where="worker", advice="start again")
        return unpack_solved(self.payload)

    def preview(self) -> Image:
        """Return the picture (height, width, 3), RGB, from a PREVIEW message."""
        if self.kind is not MessageKind.PREVIEW or len(self.payload) < _PICTURE.size:
            raise CaptureError(f"a {self.kind.name} message holds no picture", where="worker", advice="start again")
        width, height = _PICTURE.unpack_from(self.payload)
        values = np.frombuffer(self.payload, np.uint8, offset=_PICTURE.size)
        if len(values) != width * height * 3:
            raise CaptureError("a picture is damaged", where="worker", advice="start again")
        return values.reshape(height, width, 3)


def encode(kind: MessageKind, payload: bytes = b"") -> bytes:
    """Return a message as bytes."""
    if len(payload) > MAX_PAYLOAD:
        raise CaptureError(
            f"a {kind.name} message has {len(payload)} bytes, but at most {MAX_PAYLOAD} are allowed",
            where="worker",
            advice="report this",
        )
    return _HEADER.pack(MAGIC, VERSION, kind, len(payload)) + payload


def encode_json(kind: MessageKind, content: Mapping[str, Any]) -> bytes:
    """Return a control message as bytes."""
    return encode(kind, json.dumps(content, default=plain).encode("utf-8"))


def encode_frame(stamp_s: float, frame: MarkerFrame) -> bytes:
    """Return a FRAME message; `stamp_s` is `time.perf_counter()` of the images."""
    return encode(MessageKind.FRAME, pack_stamped(stamp_s, frame))


def encode_preview(picture: Image) -> bytes:
    """Return a PREVIEW message of a picture (height, width, 3), RGB, as bytes."""
    height, width = picture.shape[:2]
    return encode(MessageKind.PREVIEW, _PICTURE.pack(width, height) + np.ascontiguousarray(picture).tobytes())


class Decoder:
    """Splits a stream of bytes into messages."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Message]:
        """Add bytes; return the messages that are now complete.

        Raises:
            CaptureError: The stream has another protocol or version, or is damaged.
        """
        self._buffer += data
        messages: list[Message] = []
        start = 0
        while len(self._buffer) - start >= _HEADER.size:
            kind, length = self._header(start)
            stop = start + _HEADER.size + length
            if len(self._buffer) < stop:
                break
            messages.append(Message(kind, bytes(self._buffer[start + _HEADER.size : stop])))
            start = stop
        del self._buffer[:start]
        return messages

    def _header(self, start: int) -> tuple[MessageKind, int]:
        magic, version, number, length = _HEADER.unpack_from(self._buffer, start)
        if magic != MAGIC:
            raise CaptureError("sent a damaged message", where="worker", advice="start again")
        if version != VERSION:
            raise CaptureError(
                f"speaks protocol {version}, but this add-on speaks {VERSION}", where="worker", advice="restart Blender"
            )
        if (
            length > (MAX_PAYLOAD if number in _LONG_KINDS else _MAX_CONTROL)
            or number not in MessageKind._value2member_map_
        ):
            what = f"sent an invalid message (kind {number}, {length} bytes)"
            raise CaptureError(what, where="worker", advice="start again")
        return MessageKind(number), length
