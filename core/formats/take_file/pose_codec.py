"""Codec of solved poses, for takes and for messages between processes.

A scene pose begins with its first performer, whose notes are those of the whole scene.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...body.body_parts import PARTS
from ...body.pose_notes import PoseNote
from ...body.scene_pose import PerformerPose, PropPose, ScenePose
from ...errors import CaptureError, TakeError
from .chunks import join_records, split_records

_MAGIC = b"PFPF"
# Poses are written in the lowest version that can hold them, for the sake of older readers. The last version is a pose
# of a lower version followed by the errors of body parts.
_ONE_PERFORMER, _WITH_PROPS, _SEVERAL_PERFORMERS, _WITH_PART_ERRORS = 1, 2, 3, 4
# magic, version, joints, markers, bytes of notes, number, time, confidence, RMS, neighbours, dimensions
_HEADER = struct.Struct("<4sHHHHqdddii")
_PART_ERRORS = struct.Struct("<4sHHI")  # magic, version, parts, bytes of the pose
_PROPS = struct.Struct("<H")  # number of props
_PROP = struct.Struct("<7ddi")  # rotation, position, RMS, markers seen
_TIMED_HEADER = struct.Struct("<ddI")  # stamp, seconds in the solver, frames waiting
_AGAIN = "start again"


@dataclass(frozen=True)
class TimedPose:
    """Solved pose of one marker frame.

    Args:
        stamp_s: `time.perf_counter()` at the arrival of the frame's images.
        solve_s: Solve time.
        waiting: Marker frames in the queue behind this one.
    """

    pose: ScenePose
    stamp_s: float
    solve_s: float = 0.0
    waiting: int = 0


def pack_solved(timed: TimedPose) -> bytes:
    """Return a solved pose as bytes."""
    return _TIMED_HEADER.pack(timed.stamp_s, timed.solve_s, timed.waiting) + pack_pose(timed.pose)


def unpack_solved(data: bytes) -> TimedPose:
    """Return the pose from the bytes of `pack_solved`; CaptureError if they are invalid."""
    if len(data) < _TIMED_HEADER.size:
        raise CaptureError("a pose was cut off", where="worker", advice=_AGAIN)
    stamp_s, solve_s, waiting = _TIMED_HEADER.unpack_from(data)
    return TimedPose(unpack_pose(data[_TIMED_HEADER.size :]), stamp_s, solve_s, waiting)


def pack_pose(pose: ScenePose) -> bytes:
    """Return a pose as bytes, with the errors of body parts if known."""
    data, parts = _pack_scene(pose), max(len(performer.part_errors_deg) for performer in pose.performers)
    if not parts:
        return data
    unknown = np.full(parts, np.nan)
    rows = [performer.part_errors_deg if len(performer.part_errors_deg) else unknown for performer in pose.performers]
    header = _PART_ERRORS.pack(_MAGIC, _WITH_PART_ERRORS, parts, len(data))
    return header + data + np.array(rows).astype("<f4").tobytes()


def unpack_pose(data: bytes) -> ScenePose:
    """Return the pose from the bytes of `pack_pose`; CaptureError if they are invalid."""
    if len(data) < _PART_ERRORS.size:
        raise CaptureError("a pose was cut off", where="worker", advice=_AGAIN)
    magic, version, parts, size = _PART_ERRORS.unpack_from(data)
    if magic != _MAGIC or version != _WITH_PART_ERRORS:
        return _unpack_scene(data)
    at = _PART_ERRORS.size + size
    pose = _unpack_scene(data[_PART_ERRORS.size : at])
    if parts != len(PARTS) or len(data) != at + 4 * parts * len(pose.performers):
        raise CaptureError("the errors of the body's parts are incomplete", where=f"frame {pose.number}", advice=_AGAIN)
    rows = np.frombuffer(data, dtype="<f4", offset=at).astype(np.float64).reshape(-1, parts)
    known = [row if np.isfinite(row).all() else row[:0] for row in rows]
    performers = (replace(each, part_errors_deg=row) for each, row in zip(pose.performers, known, strict=True))
    return replace(pose, performers=tuple(performers))


def _pack_scene(pose: ScenePose) -> bytes:
    """Return first performer, props and further performers as bytes."""
    first, further = replace(pose.performers[0], notes=pose.notes), pose.performers[1:]
    if further:
        parts = [_pack_props(pose.props), *(_pack_performer(performer, _ONE_PERFORMER) for performer in further)]
        return _pack_performer(first, _SEVERAL_PERFORMERS) + join_records(parts)
    if pose.props:
        return _pack_performer(first, _WITH_PROPS) + _pack_props(pose.props)
    return _pack_performer(first, _ONE_PERFORMER)


def _unpack_scene(data: bytes) -> ScenePose:
    """Return the pose from the bytes of `_pack_scene`; CaptureError if they are invalid."""
    version, first, rest = _unpack_performer(data)
    try:
        if version == _SEVERAL_PERFORMERS:
            props, *further = split_records(rest)
            if not further:
                raise struct.error("no further performer")
            performers = (first, *map(_only_performer, further))
            return ScenePose(performers, _unpack_props(props), first.notes)
        if version == _WITH_PROPS:
            return ScenePose((first,), _unpack_props(rest), first.notes)
        if rest:
            raise struct.error("another length")
        return ScenePose((first,), (), first.notes)
    except (struct.error, ValueError, TakeError) as error:
        raise CaptureError("a pose was cut off", where=f"frame {first.number}", advice=_AGAIN) from error


def _pack_performer(pose: PerformerPose, version: int) -> bytes:
    notes = "\n".join(note.text for note in pose.notes).encode("utf-8")
    sizes = (len(pose.rotations), len(pose.markers_m), len(notes))
    facts = (pose.number, pose.time_s, pose.confidence, pose.marker_rms_m, pose.neighbours, pose.dimensions)
    header = _HEADER.pack(_MAGIC, version, *sizes, *facts)
    arrays = (pose.rotations, pose.root_position_m, pose.markers_m, pose.observed_m)
    floats = np.concatenate([np.ravel(array) for array in arrays])
    return header + floats.astype("<f8").tobytes() + pose.single_cameras.astype("<i8").tobytes() + notes


def _unpack_performer(data: bytes) -> tuple[int, PerformerPose, bytes]:
    """Return version, pose, and the remaining bytes."""
    if len(data) < _HEADER.size:
        raise CaptureError("a pose was cut off", where="worker", advice=_AGAIN)
    magic, version, joints, markers, note_bytes, number, time_s, confidence, rms, neighbours, dimensions = (
        _HEADER.unpack_from(data)
    )
    if magic != _MAGIC or version not in (_ONE_PERFORMER, _WITH_PROPS, _SEVERAL_PERFORMERS):
        raise CaptureError("sent poses of another version of Perfanim", where="worker", advice="restart Blender")
    floats = 4 * joints + 3 + 6 * markers
    notes_at = _HEADER.size + 8 * (floats + markers)
    end = notes_at + note_bytes
    if len(data) < end:
        raise CaptureError("a pose was cut off", where=f"frame {number}", advice=_AGAIN)
    values = np.frombuffer(data, dtype="<f8", count=floats, offset=_HEADER.size)
    single_cameras = np.frombuffer(data, dtype="<i8", count=markers, offset=_HEADER.size + 8 * floats)
    rotations, root, markers_m, observed_m = np.split(values, np.cumsum((4 * joints, 3, 3 * markers)))
    notes = data[notes_at:end].decode("utf-8", errors="replace")
    pose = PerformerPose(
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
        notes=tuple(map(PoseNote.of_text, notes.split("\n"))) if notes else (),
    )
    return version, pose, data[end:]


def _only_performer(data: bytes) -> PerformerPose:
    """Return the pose of one performer; struct.error if any bytes are left."""
    version, pose, rest = _unpack_performer(data)
    if version != _ONE_PERFORMER or rest:
        raise struct.error("another length")
    return pose


def _pack_props(props: Sequence[PropPose]) -> bytes:
    rows = [_PROP.pack(*prop.rotation, *prop.position_m, prop.rms_m, prop.seen) for prop in props]
    return _PROPS.pack(len(props)) + b"".join(rows)


def _unpack_props(data: bytes) -> tuple[PropPose, ...]:
    """Return the props from the bytes of `_pack_props`; struct.error if they are invalid."""
    (count,) = _PROPS.unpack_from(data)
    if len(data) != _PROPS.size + count * _PROP.size:
        raise struct.error("another length")
    rows = (np.array(row) for row in _PROP.iter_unpack(data[_PROPS.size :]))
    return tuple(PropPose(row[:4], row[4:7], float(row[7]), int(row[8])) for row in rows)
