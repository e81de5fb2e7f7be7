"""Motion database file: a JSON header and aligned arrays, which are memory-mapped when the file is opened.

Layout: magic, version (u32), header length (u64), file length (u64), header digest (32 bytes), header (JSON), padding,
arrays. The file length and the digest reveal a truncated file. Checksums of the arrays, which files of earlier versions
lack, are compared before a solve and reveal changed bytes.
"""

import hashlib
import json
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..body.skeleton import Skeleton
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import DatabaseError, counted
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray
from ..system.file_content import check_kind
from ..system.files import atomic_path, is_file, open_foreign, reading
from .cells import SETTINGS, build_cells
from .header_facts import FASTEST, SLOWEST, ArrayPlace, Clip, Header, read_header
from .skeleton_facts import REBUILD, skeleton_facts

DATABASE_SUFFIX = ".pfdb"
OLD_DATABASE_SUFFIX = ".perfdb"  # suffix up to version 0.1, for the same format

_MAGIC = b"PERFANIM-DB\n"
_VERSION, _CELLS_VERSION = 2, 3  # without and with cells for the search
_VERSIONS = (1, _VERSION, _CELLS_VERSION)  # version 1 lacks the subjects' reference poses
_PREAMBLE = struct.Struct("<12sIQQ32s")
_ALIGNMENT = 64  # bytes


@dataclass(frozen=True)
class ReferencePose:
    """Local rotations (J, 4) that one subject's poses are relative to."""

    subject: str
    skeleton: int
    mirrored: bool
    rotations: Array


@dataclass(frozen=True)
class Database:
    """Poses of many clips at one rate.

    Args:
        clips: Clips in the order of their frames, without gaps.
        skeletons: Bodies of the subjects, with the standard joints.
        mean_rotations: Common reference pose (J, 4), close to the mean local rotation of each joint, so that no joint
            angle comes near 180 degrees, where rotation vectors jump.
        poses: Float32 rotation vectors (F, J - 1, 3) of all joints but the root: local = reference * exp(pose).
        root_rotations: Float32 world-from-root (F, 4).
        root_positions_m: Float32 positions (F, 3).
        cells: Index (F,) of each frame's cell of similar frames, see `build_cells`; None in a small database.
        culled_frames: Number of near-duplicates that were left out when the database was built.
        reference_poses: Reference poses of subjects that have their own; the others use the common one.
    """

    path: Path
    fps: float
    clips: tuple[Clip, ...]
    skeletons: tuple[Skeleton, ...]
    mean_rotations: Array
    poses: FloatArray
    root_rotations: FloatArray
    root_positions_m: FloatArray
    cells: NDArray[np.int32] | None = None
    culled_frames: int = 0
    reference_poses: tuple[ReferencePose, ...] = ()

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.poses)

    @property
    def behaviours(self) -> dict[str, int]:
        """Number of frames of each behaviour."""
        return self._frames_by(lambda clip: clip.behaviour)

    @property
    def source_rates(self) -> dict[str, int]:
        """Number of frames for each rate of the source files, Hz."""
        return self._frames_by(lambda clip: f"{clip.source_fps:g}")

    def _frames_by(self, key: Callable[[Clip], str]) -> dict[str, int]:
        counts = Counter[str]()
        for clip in self.clips:
            counts[key(clip)] += clip.stop - clip.start
        return dict(counts)

    @cached_property
    def clip_of_frame(self) -> NDArray[np.int32]:
        """Clip index (F,) of each frame."""
        return np.repeat(np.arange(len(self.clips), dtype=np.int32), [c.stop - c.start for c in self.clips])

    @cached_property
    def _reference_pose_of_clip(self) -> Array:
        """Reference pose (C, J, 4) of each clip."""
        own = {(each.subject, each.skeleton, each.mirrored): each.rotations for each in self.reference_poses}
        subjects = ((clip.subject, clip.skeleton, clip.mirrored) for clip in self.clips)
        return np.array([own.get(subject, self.mean_rotations) for subject in subjects])

    def reference_pose_of(self, skeleton: Skeleton, name: str = "") -> Array:
        """Return the reference pose (J, 4) of a recorded skeleton or subject, or the common one if there is none.

        Args:
            name: Name of the subject; a subject of this name in the database counts as the same person even if the
                measured bones differ.
        """
        own = [each for each in self.reference_poses if not each.mirrored]
        same = (each for each in own if same_bones(self.skeletons[each.skeleton].offsets_m, skeleton.offsets_m))
        named = (each for each in own if each.subject == name)
        found = next(same, None) or next(named, None)
        return found.rotations if found else self.mean_rotations

    def own_frames(self, skeleton: Skeleton, name: str = "") -> NDArray[np.bool_]:
        """Return a mask (F,) of the frames with this skeleton or of the subject with this name."""
        same = [same_bones(body.offsets_m, skeleton.offsets_m) for body in self.skeletons]
        own = [same[clip.skeleton] or (name != "" and clip.subject == name) for clip in self.clips]
        return np.array(own, dtype=np.bool_)[self.clip_of_frame]

    def local_rotations(self, frames: Any) -> Array:
        """Return the local rotations (..., J, 4) of frames; the root's is world-from-root."""
        references = self._reference_pose_of_clip[self.clip_of_frame[frames]]
        poses = np.asarray(self.poses[frames], dtype=np.float64)
        return rotations_from_pose(poses, references, self.root_rotations[frames])


def same_bones(offsets_m: Array, others_m: Array, most_m: float = 2e-4) -> bool:
    """Return whether the joint offsets (J, 3) of two skeletons differ only by rounding, by less than `most_m`."""
    return offsets_m.shape == others_m.shape and float(np.max(np.abs(offsets_m - others_m))) < most_m


def rotations_from_pose(pose: Array, mean_rotations: Array, root_rotation: Any) -> Array:
    """Return local rotations (..., J, 4) of poses (..., J - 1, 3)."""
    result = np.empty((*pose.shape[:-2], pose.shape[-2] + 1, 4))
    result[..., 0, :] = root_rotation
    result[..., 1:, :] = rot.multiply(mean_rotations[..., 1:, :], rot.from_rotation_vector(pose))
    return result


def pose_from_rotations(rotations: Any, mean_rotations: Array) -> Array:
    """Return poses (..., J - 1, 3) of local rotations (..., J, 4)."""
    local = np.asarray(rotations, dtype=np.float64)[..., 1:, :]
    # contiguous components make this several times as fast as `rot.to_rotation_vector`
    rows = np.ascontiguousarray(np.moveaxis(local.reshape(-1, *local.shape[-2:]), 0, -1))  # shape (J - 1, 4, F)
    turned = rot.left_matrices(rot.conjugate(mean_rotations[1:])) @ rows
    w, vectors = turned[:, 0], turned[:, 1:]
    # the bound avoids a division by zero
    sines = np.maximum(np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2), 1e-150)
    vectors *= np.copysign(2.0 * np.arctan2(sines, np.abs(w)) / sines, w)[:, None]
    return np.moveaxis(vectors, -1, 0).reshape(*local.shape[:-1], 3)


def save_database(database: Database) -> None:
    """Write a database to its path, with cells if it is large; DatabaseError if its parts do not fit together."""
    _check_parts(database)
    arrays: dict[str, NDArray[Any]] = {
        "mean_rotations": database.mean_rotations,
        "poses": database.poses,
        "root_rotations": np.asarray(database.root_rotations, dtype=np.float32),
        "root_positions_m": np.asarray(database.root_positions_m, dtype=np.float32),
    }
    if database.frames >= SETTINGS.least_frames:
        arrays["cells"] = build_cells(database.poses, database.mean_rotations)
    if database.reference_poses:
        arrays["zeros"] = np.array([each.rotations for each in database.reference_poses])
    facts = {
        "fps": float(database.fps),
        "joints": list(JOINT_NAMES),
        "clips": [dict(vars(clip)) for clip in database.clips],
        "skeletons": [skeleton_facts(skeleton) for skeleton in database.skeletons],
        "culled_frames": database.culled_frames,
        "zeros": [[each.subject, each.skeleton, each.mirrored] for each in database.reference_poses],
    }
    with atomic_path(database.path) as temporary, temporary.open("wb") as stream:
        _write_file(stream, facts, arrays)


def _check_parts(database: Database) -> None:
    where, clips, shape = str(database.path), database.clips, database.root_positions_m.shape
    if not (SLOWEST <= database.fps <= FASTEST and database.frames):
        raise DatabaseError(
            f"has {counted(database.frames, 'frame')} at {database.fps:g} Hz, "
            f"but needs at least 1 at {SLOWEST:g} to {FASTEST:g} Hz",
            where=where,
            advice=REBUILD,
        )
    if shape != (database.frames, 3):
        raise DatabaseError(
            f"root positions have shape {shape}, not ({database.frames}, 3)", where=where, advice=REBUILD
        )
    edges = [clip.start for clip in clips] + [database.frames]
    if edges[0] != 0 or [clip.stop for clip in clips] != edges[1:]:
        raise DatabaseError("its clips do not cover its frames", where=where, advice=REBUILD)
    bodies = [clip.skeleton for clip in clips] + [each.skeleton for each in database.reference_poses]
    if not all(0 <= body < len(database.skeletons) for body in bodies):
        raise DatabaseError("a clip or a reference pose has no skeleton", where=where, advice=REBUILD)


def _write_file(stream: BinaryIO, facts: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    position = 0
    layout: dict[str, dict[str, Any]] = {}
    for name, array in arrays.items():
        position += -position % _ALIGNMENT
        layout[name] = {
            "dtype": array.dtype.str,
            "shape": list(array.shape),
            "offset": position,
            "crc32": _crc32(array),
        }
        position += array.nbytes
    header = json.dumps(facts | {"arrays": layout}).encode("utf-8")
    start = _PREAMBLE.size + len(header)
    start += -start % _ALIGNMENT
    digest = hashlib.sha256(header).digest()
    version = _CELLS_VERSION if "cells" in arrays else _VERSION
    stream.write(_PREAMBLE.pack(_MAGIC, version, len(header), start + position, digest))
    stream.write(header)
    for name, array in arrays.items():
        stream.write(b"\0" * (start + layout[name]["offset"] - stream.tell()))
        stream.write(np.ascontiguousarray(array).data)


def open_database(path: str | Path) -> Database:
    """Return a file's database, with memory-mapped arrays; "starter" is the starter database.

    Raises:
        DatabaseError: The file is truncated or not a database, or the starter database cannot be built.
    """
    from .starter_database import named_database  # it builds with this module

    path = named_database(path)
    with open_foreign(path, DatabaseError) as stream, reading(path, DatabaseError, REBUILD):
        header, arrays = _map_arrays(path, stream)
        if header.joints != JOINT_NAMES:
            raise DatabaseError("was made for other joints", where=str(path), advice=REBUILD)
        return _database_from(path, header, arrays)


def check_file(database: Database) -> None:
    """Raise DatabaseError if the file was cut off after it was opened; the lost part would be read as zeros.

    A file that was replaced or deleted stays readable.
    """
    if is_file(database.path):
        with open_foreign(database.path, DatabaseError) as stream, reading(database.path, DatabaseError, REBUILD):
            _read_header(database.path, stream)


def _map_arrays(path: Path, stream: BinaryIO) -> tuple[Header, dict[str, NDArray[Any]]]:
    """Return a file's header and mapped arrays; a damaged file may raise any exception."""
    data = _read_header(path, stream)
    header, start = read_header(path, data), _PREAMBLE.size + len(data)
    start += -start % _ALIGNMENT
    return header, {name: _map_array(path, start, place) for name, place in header.arrays.items()}


def _crc32(array: NDArray[Any]) -> int:
    return zlib.crc32(np.ascontiguousarray(array).data.cast("B")) if array.size else 0


def _read_header(path: Path, stream: BinaryIO) -> bytes:
    """Return the header of a database file; DatabaseError if the file is shorter than it should be."""
    size = stream.seek(0, 2)
    stream.seek(0)
    preamble = stream.read(_PREAMBLE.size)
    if len(preamble) < _PREAMBLE.size or not preamble.startswith(_MAGIC):
        check_kind(preamble, str(path), "motion database", DatabaseError, advice=REBUILD)
        raise DatabaseError("is not a motion database", where=str(path), advice=REBUILD)
    _, version, header_bytes, file_bytes, digest = _PREAMBLE.unpack(preamble)
    if version not in _VERSIONS:
        what = f"has version {version}, but only versions {_VERSIONS[0]} to {_VERSIONS[-1]} can be read"
        raise DatabaseError(what, where=str(path), advice=REBUILD)
    if size != file_bytes:
        what = f"is cut off: {size} of {file_bytes} bytes" if size < file_bytes else "is longer than its header says"
        raise DatabaseError(what, where=str(path), advice=REBUILD)
    header = stream.read(min(header_bytes, size))
    if hashlib.sha256(header).digest() != digest:
        raise DatabaseError("is damaged", where=str(path), advice=REBUILD)
    return header


def _database_from(path: Path, header: Header, arrays: Mapping[str, NDArray[Any]]) -> Database:
    """Return the database from a header and mapped arrays; a damaged file may raise any exception."""
    frames, joints, owners = len(arrays["poses"]), len(JOINT_NAMES), header.reference_owners
    expected = {
        "mean_rotations": ("<f8", (joints, 4)),
        "poses": ("<f4", (frames, joints - 1, 3)),
        "root_rotations": ("<f4", (frames, 4)),
        "root_positions_m": ("<f4", (frames, 3)),
        "zeros": ("<f8", (len(owners), joints, 4)),
        "neighbours": ("<i4", (frames, arrays["neighbours"].shape[-1] if "neighbours" in arrays else 0)),
        "clusters": ("<i4", (frames,)),
        "cells": ("<i4", (frames,)),
    }
    for name, array in arrays.items():
        if (array.dtype.str, array.shape) != expected[name]:
            raise ValueError(f"{name} has the shape {array.shape} and the type {array.dtype.str}")
    own = [
        ReferencePose(owner.subject, owner.skeleton, owner.mirrored, np.array(rotations))
        for owner, rotations in zip(owners, arrays.get("zeros", ()), strict=True)
    ]
    database = Database(
        path=path,
        fps=header.fps,
        clips=header.clips,
        skeletons=header.skeletons,
        mean_rotations=np.array(arrays["mean_rotations"]),
        poses=arrays["poses"],
        root_rotations=arrays["root_rotations"],
        root_positions_m=arrays["root_positions_m"],
        cells=arrays.get("cells", arrays.get("clusters")),  # earlier versions stored a graph's clusters here
        culled_frames=header.culled_frames,
        reference_poses=tuple(own),
    )
    _check_parts(database)
    if not all(map(_are_unit, (database.mean_rotations, *(each.rotations for each in own)))):
        raise ValueError("a reference rotation is not a unit quaternion")
    return database


def _are_unit(rotations: NDArray[Any]) -> bool:
    """Return whether quaternions (..., 4) have unit length to float32 accuracy, with a margin."""
    return bool(np.all(np.abs(np.linalg.norm(rotations, axis=-1) - 1.0) < 1e-3))


def check_arrays(database: Database, chunk: int = 1 << 14, largest: float = 1e5) -> None:
    """Read all arrays once before a solve; DatabaseError if bytes have changed or poses are invalid.

    Args:
        chunk: Frames checked at once.
        largest: Largest valid rotation vector or position, radians or metres.
    """
    if is_file(database.path):
        with open_foreign(database.path, DatabaseError) as stream, reading(database.path, DatabaseError, REBUILD):
            header, arrays = _map_arrays(database.path, stream)
            for name, place in header.arrays.items():
                if place.crc32 is not None and place.crc32 != _crc32(arrays[name]):
                    what = f"is damaged: its {name} have changed"
                    raise DatabaseError(what, where=str(database.path), advice=REBUILD)
    for start in range(0, database.frames, chunk):
        part = slice(start, start + chunk)
        is_valid = _are_unit(database.root_rotations[part])
        is_valid &= all(np.max(np.abs(each[part])) < largest for each in (database.poses, database.root_positions_m))
        if database.cells is not None:
            is_valid &= bool(np.all((database.cells[part] >= 0) & (database.cells[part] < database.frames)))
        if not is_valid:
            where, advice = f"{database.path}, frames from {start}", "build the database again"
            raise DatabaseError("contains invalid poses", where=where, advice=advice)


def identity(database: Database) -> dict[str, Any]:
    """Return facts that identify a database: file, frames, rate, header digest."""
    with database.path.open("rb") as stream:
        digest = _PREAMBLE.unpack(stream.read(_PREAMBLE.size))[-1].hex()
    path = str(database.path.resolve())
    return {"path": path, "frames": database.frames, "fps": database.fps, "sha256": digest}


def _map_array(path: Path, start: int, place: ArrayPlace) -> NDArray[Any]:
    return np.memmap(path, dtype=place.dtype, mode="r", offset=start + place.offset, shape=place.shape)
