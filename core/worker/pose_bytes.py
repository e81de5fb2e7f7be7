"""A pose frame as bytes on its way from the solver's process to Blender; versioned and checked, never pickle."""

import struct

import numpy as np

from ..errors import CaptureError
from ..pose_frame import PoseFrame

_MAGIC = b"PFPF"
_VERSION = 1
# magic, version, joints, markers, note bytes, number, time, confidence, RMS, neighbours, dimensions
_HEADER = struct.Struct("<4sHHHHqdddii")


def pack_pose(pose: PoseFrame) -> bytes:
    """Return the pose as bytes: little-endian header, arrays, notes."""
    notes = "\n".join(pose.notes).encode("utf-8")
    header = _HEADER.pack(
        _MAGIC,
        _VERSION,
        len(pose.rotations),
        len(pose.labels),
        len(notes),
        pose.number,
        pose.time_s,
        pose.confidence,
        pose.marker_rms_m,
        pose.neighbours,
        pose.dimensions,
    )
    floats = np.concatenate([np.ravel(a) for a in (pose.rotations, pose.root_position_m, pose.markers_m)])
    whole = np.concatenate((pose.labels, pose.rays))
    return header + floats.astype("<f8").tobytes() + whole.astype("<i8").tobytes() + notes


def unpack_pose(data: bytes) -> PoseFrame:
    """Return the pose of `pack_pose`; CaptureError when the bytes are not one whole pose of this version."""
    if len(data) < _HEADER.size:
        raise CaptureError("a pose was cut off", where="worker")
    magic, version, joints, markers, note_bytes, number, time_s, confidence, rms, neighbours, dimensions = (
        _HEADER.unpack_from(data)
    )
    if magic != _MAGIC or version != _VERSION:
        raise CaptureError("the solver's process speaks another version", advice="restart Blender")
    floats, whole = 4 * joints + 3 + 3 * markers, 2 * markers
    notes_at = _HEADER.size + 8 * (floats + whole)
    if len(data) != notes_at + note_bytes:
        raise CaptureError("a pose was cut off", where=f"frame {number}")
    values = np.frombuffer(data, dtype="<f8", count=floats, offset=_HEADER.size)
    indices = np.frombuffer(data, dtype="<i8", count=whole, offset=_HEADER.size + 8 * floats)
    notes = data[notes_at:].decode("utf-8")
    return PoseFrame(
        number=number,
        time_s=time_s,
        rotations=values[: 4 * joints].reshape(joints, 4),
        root_position_m=values[4 * joints : 4 * joints + 3],
        confidence=confidence,
        markers_m=values[4 * joints + 3 :].reshape(markers, 3),
        labels=indices[:markers],
        rays=indices[markers:],
        marker_rms_m=rms,
        neighbours=neighbours,
        dimensions=dimensions,
        notes=tuple(notes.split("\n")) if notes else (),
    )
