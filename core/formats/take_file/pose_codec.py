"""A pose frame as bytes, on its way from the solver to Blender and in takes; versioned and checked, never pickle."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...body.scene_pose import PerformerPose, PropPose
from ...errors import CaptureError

_MAGIC = b"PFPF"
_VERSION, _WITH_PROPS, _WITH_OTHERS = 1, 2, 3  # one without other targets is of version 1, as ever
# magic, version, joints, markers, note bytes, number, time, confidence, RMS, neighbours, dimensions
_HEADER = struct.Struct("<4sHHHHqdddii")
_PROPS = struct.Struct("<H")  # how many
_PROP = struct.Struct("<7ddi")  # rotation, position, RMS, markers seen
_LENGTH = struct.Struct("<I")  # bytes of the props, or of a further performer's pose
_SOLVED_HEAD = struct.Struct("<ddI")  # stamp, seconds in the solver, frames waiting


@dataclass(frozen=True)
class TimedPose:
    """A pose as it leaves the solver.

    Args:
        pose: of one marker frame.
        stamp_s: `time.perf_counter()` when the frame's images were in hand.
        solve_s: time that `Session.step` took.
        waiting: marker frames that had arrived by then and were not solved.
    """

    pose: PerformerPose
    stamp_s: float
    solve_s: float = 0.0
    waiting: int = 0


def pack_solved(solved: TimedPose) -> bytes:
    """Return a solved pose as bytes."""
    return _SOLVED_HEAD.pack(solved.stamp_s, solved.solve_s, solved.waiting) + pack_pose(solved.pose)


def unpack_solved(data: bytes) -> TimedPose:
    """Return the solved pose of `pack_solved`; CaptureError when the bytes are not one whole one of this version."""
    if len(data) < _SOLVED_HEAD.size:
        raise CaptureError("a pose was cut off", where="worker")
    stamp_s, solve_s, waiting = _SOLVED_HEAD.unpack_from(data)
    return TimedPose(unpack_pose(data[_SOLVED_HEAD.size :]), stamp_s, solve_s, waiting)


def pack_pose(pose: PerformerPose) -> bytes:
    """Return the pose as bytes: little-endian header, arrays, notes, and further targets where the capture has any."""
    notes = "\n".join(pose.notes).encode("utf-8")
    header = _HEADER.pack(
        _MAGIC,
        _WITH_OTHERS if pose.others else _WITH_PROPS if pose.props else _VERSION,
        len(pose.rotations),
        len(pose.markers_m),
        len(notes),
        pose.number,
        pose.time_s,
        pose.confidence,
        pose.marker_rms_m,
        pose.neighbours,
        pose.dimensions,
    )
    arrays = (pose.rotations, pose.root_position_m, pose.markers_m, pose.observed_m)
    floats = np.concatenate([np.ravel(array) for array in arrays])
    packed = header + floats.astype("<f8").tobytes() + pose.single_cameras.astype("<i8").tobytes() + notes
    if pose.others:
        return packed + b"".join(_sized(part) for part in (_pack_props(pose.props), *map(pack_pose, pose.others)))
    return packed + _pack_props(pose.props) if pose.props else packed


def _pack_props(props: Sequence[PropPose]) -> bytes:
    rows = [_PROP.pack(*prop.rotation, *prop.position_m, prop.rms_m, prop.seen) for prop in props]
    return _PROPS.pack(len(props)) + b"".join(rows)


def _unpack_props(data: bytes) -> tuple[PropPose, ...]:
    """Return the props of `_pack_props`; struct.error when the bytes are not they."""
    (count,) = _PROPS.unpack_from(data)
    if len(data) != _PROPS.size + count * _PROP.size:
        raise struct.error("another length")
    rows = (np.array(row) for row in _PROP.iter_unpack(data[_PROPS.size :]))
    return tuple(PropPose(row[:4], row[4:7], float(row[7]), int(row[8])) for row in rows)


def _sized(part: bytes) -> bytes:
    return _LENGTH.pack(len(part)) + part


def _unpack_targets(version: int, data: bytes) -> tuple[tuple[PropPose, ...], tuple[PerformerPose, ...]]:
    """Return props and further performers of a pose; struct.error when the bytes are not they."""
    if version == _VERSION and data:
        raise struct.error("another length")
    if version != _WITH_OTHERS:
        return _unpack_props(data) if version == _WITH_PROPS else (), ()
    parts, position = [], 0
    while position < len(data):
        (length,) = _LENGTH.unpack_from(data, position)
        position += _LENGTH.size
        if position + length > len(data):
            raise struct.error("cut off")
        parts.append(data[position : position + length])
        position += length
    if len(parts) < 2:
        raise struct.error("no further performer")
    return _unpack_props(parts[0]), tuple(unpack_pose(part) for part in parts[1:])


def unpack_pose(data: bytes) -> PerformerPose:
    """Return the pose of `pack_pose`; CaptureError when the bytes are not one whole pose of this version."""
    if len(data) < _HEADER.size:
        raise CaptureError("a pose was cut off", where="worker")
    magic, version, joints, markers, note_bytes, number, time_s, confidence, rms, neighbours, dimensions = (
        _HEADER.unpack_from(data)
    )
    if magic != _MAGIC or version not in (_VERSION, _WITH_PROPS, _WITH_OTHERS):
        raise CaptureError("the solver's process speaks another version", advice="restart Blender")
    floats = 4 * joints + 3 + 6 * markers
    notes_at = _HEADER.size + 8 * (floats + markers)
    targets_at = notes_at + note_bytes
    if len(data) < targets_at:
        raise CaptureError("a pose was cut off", where=f"frame {number}")
    try:
        props, others = _unpack_targets(version, data[targets_at:])
    except struct.error as error:
        raise CaptureError("a pose was cut off", where=f"frame {number}") from error
    values = np.frombuffer(data, dtype="<f8", count=floats, offset=_HEADER.size)
    single_cameras = np.frombuffer(data, dtype="<i8", count=markers, offset=_HEADER.size + 8 * floats)
    rotations, root, markers_m, observed_m = np.split(values, np.cumsum((4 * joints, 3, 3 * markers)))
    notes = data[notes_at:targets_at].decode("utf-8")
    return PerformerPose(
        number=number,
        time_s=time_s,
        rotations=rotations.reshape(joints, 4),
        root_position_m=root,
        confidence=confidence,
        markers_m=markers_m.reshape(markers, 3),
        observed_m=observed_m.reshape(markers, 3),
        single_cameras=single_cameras,
        marker_rms_m=rms,
        neighbours=neighbours,
        dimensions=dimensions,
        notes=tuple(notes.split("\n")) if notes else (),
        props=props,
        others=others,
    )
