"""Databases made from arrays, and from parts of another database."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import JOINT_NAMES
from perfanim.core.database.header_facts import Clip
from perfanim.core.database.reference_poses import relative_poses
from perfanim.core.database.store import Database, open_database, save_database
from perfanim.core.errors import DatabaseError

Part = tuple[Clip, int, int]  # first frame of the clip that is kept, and the one after the last


def write_database(
    path: str | Path,
    fps: float,
    rotations: NDArray[Any],
    root_positions_m: NDArray[Any],
    clips: Sequence[Clip],
    skeletons: Sequence[Skeleton],
) -> None:
    """Write a database file from local rotations (F, J, 4) of the standard skeleton; clips cover them in order."""
    if len(rotations) == 0:
        raise DatabaseError("has no motion to store", where=str(path), advice="add files with motion")
    if rotations.shape[1:] != (len(JOINT_NAMES), 4):
        raise DatabaseError(f"rotations have shape {rotations.shape}, not (F, {len(JOINT_NAMES)}, 4)", where=str(path))
    mean_rotations, references, poses = relative_poses(rotations, clips)
    parts = (tuple(clips), tuple(skeletons), mean_rotations, poses, rotations[:, 0], root_positions_m)
    save_database(Database(Path(path), fps, *parts, reference_poses=references))


def write_subset(database: Database, path: str | Path, kept: Iterable[Part]) -> Database:
    """Write parts of a database as another database and return it.

    Raises:
        DatabaseError: Nothing is kept.
    """
    clips, parts, stop = [], [], 0
    for clip, first, last in kept:
        parts.append(np.arange(clip.start + first, clip.start + last))
        clips.append(clip.part(first, last, stop, database.fps))
        stop += last - first
    if not clips:
        raise DatabaseError("no clip is left", where=str(database.path), advice="leave out fewer clips")
    frames = np.concatenate(parts)
    rotations = np.concatenate([database.local_rotations(part).astype(np.float32) for part in parts])
    write_database(path, database.fps, rotations, database.root_positions_m[frames], clips, database.skeletons)
    return open_database(path)
