"""Conversion of marker frames to bytes, for the worker's messages and for takes."""

import math
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CaptureError
from .marker_frame import MarkerFrame

_MAGIC = b"PFMF"
# Takes contain these bytes, so newer versions must read the older ones too. Version 3 has no normalised coordinates.
_VERSION, _OLDEST = 4, 3
_HEADER = struct.Struct("<4sHHqdIIII")  # magic, version, cameras, number, time, points, rays, note bytes, body bytes
_STAMP = struct.Struct("<d")
_NOT_MOVED = 0xFFFFFFFF  # replaces a camera's number of detected blobs if these equal `blobs`
_NOT_COMPUTED = 0xFFFFFFFF  # replaces the number of normalised coordinates if none are stored


def pack(frame: MarkerFrame) -> bytes:
    """Return the frame as little-endian bytes: header, then arrays as in `_layout`."""
    notes = "\n".join(frame.notes).encode("utf-8")
    moved = [d for d, blobs in zip(frame.detected, frame.blobs, strict=True) if d is not blobs]
    counts = [len(blobs) for blobs in frame.blobs]
    counts += [_NOT_MOVED if d is b else len(d) for d, b in zip(frame.detected, frame.blobs, strict=True)]
    counts += [len(rows) for rows in frame.normalised] or [_NOT_COMPUTED] * len(frame.blobs)
    parts = [np.array(counts, dtype="<u4").tobytes()]
    parts += [np.ascontiguousarray(blobs, dtype="<f4").tobytes() for blobs in (*frame.blobs, *moved)]
    parts += [np.ascontiguousarray(rows, dtype="<f8").tobytes() for rows in frame.normalised]
    layout = _layout(len(frame.points_m), len(frame.single_cameras), len(frame.blobs))
    parts += [np.ascontiguousarray(getattr(frame, name), dtype=kind).tobytes() for name, _, kind in layout]
    body = b"".join(parts) + notes
    sizes = (len(frame.points_m), len(frame.single_cameras), len(notes), len(body))
    return _HEADER.pack(_MAGIC, _VERSION, len(frame.blobs), frame.number, frame.time_s, *sizes) + body


def unpack(data: bytes) -> MarkerFrame:
    """Return the frame from the bytes of `pack`; CaptureError if they are not a frame."""
    if len(data) < _HEADER.size:
        raise _cut_off()
    magic, version, cameras, number, time_s, points, rays, note_bytes, body_bytes = _HEADER.unpack_from(data)
    if magic != _MAGIC or not _OLDEST <= version <= _VERSION:
        raise CaptureError(
            "sent marker frames of another version of Perfanim",
            where="worker",
            advice="restart Blender after updating the extension",
        )
    reader = _Reader(data, _HEADER.size)
    counts = reader.array((2 if version == _OLDEST else 3, cameras), "<u4")
    blobs = tuple(reader.array((int(count), 5), "<f4") for count in counts[0])
    detected = tuple(
        b if count == _NOT_MOVED else reader.array((int(count), 5), "<f4")
        for b, count in zip(blobs, counts[1], strict=True)
    )
    computed = version > _OLDEST and _NOT_COMPUTED not in counts[2]
    normalised = tuple(reader.array((int(count), 2), "<f8") for count in counts[2]) if computed else ()
    arrays = {name: reader.array(shape, kind) for name, shape, kind in _layout(points, rays, cameras)}
    notes = reader.bytes(note_bytes).decode("utf-8", errors="replace")
    if len(data) != _HEADER.size + body_bytes or reader.position != len(data):
        raise _cut_off(f"frame {number}")
    lines = tuple(notes.split("\n")) if notes else ()
    return MarkerFrame(number, time_s, blobs=blobs, detected=detected, normalised=normalised, notes=lines, **arrays)


def pack_stamped(stamp_s: float, frame: MarkerFrame) -> bytes:
    """Return the bytes of `pack`, preceded by the time of the images (`time.perf_counter()`)."""
    return _STAMP.pack(stamp_s) + pack(frame)


def unpack_stamped(data: bytes) -> tuple[float, MarkerFrame]:
    """Return time and frame from the bytes of `pack_stamped`; errors are those of `unpack`."""
    if len(data) < _STAMP.size:
        raise _cut_off()
    (stamp_s,) = _STAMP.unpack_from(data)
    return stamp_s, unpack(data[_STAMP.size :])


def _cut_off(where: str = "") -> CaptureError:
    return CaptureError("a marker frame was cut off", where=where, advice="capture it again")


def _layout(points: int, rays: int, cameras: int) -> list[tuple[str, tuple[int, ...], str]]:
    return [
        ("points_m", (points, 3), "<f8"),
        ("covariances_m2", (points, 3, 3), "<f8"),
        ("labels", (points,), "<i8"),
        ("point_blobs", (points, cameras), "<i8"),
        ("single_cameras", (rays,), "<i8"),
        ("single_blobs", (rays,), "<i8"),
        ("single_points", (rays, 2), "<f8"),
        ("single_labels", (rays,), "<i8"),
        ("camera_times_s", (cameras,), "<f8"),
    ]


class _Reader:
    def __init__(self, data: bytes, position: int) -> None:
        self._data = data
        self.position = position

    def bytes(self, count: int) -> bytes:
        if self.position + count > len(self._data):
            raise _cut_off()
        self.position += count
        return self._data[self.position - count : self.position]

    def array(self, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
        count = math.prod(shape) * np.dtype(kind).itemsize
        return np.frombuffer(self.bytes(count), dtype=kind).reshape(shape)
