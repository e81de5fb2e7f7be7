"""Databases made of parts of another."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from perfanim.core.database.graph import LARGE_DATABASE, GraphSettings
from perfanim.core.database.store import Clip, Database, open_database, write_database
from perfanim.core.errors import DatabaseError


def write_subset(
    database: Database, path: str | Path, kept: Iterable[tuple[Clip, int, int]], graph: GraphSettings | None = None
) -> Database:
    """Write parts of a database as another and return it.

    Args:
        kept: clips, each with its first frame that is kept and the one after the last, counted within the clip.
        graph: how frames are joined in the neighbour graph; default the usual way where the database is large.

    Raises:
        DatabaseError: nothing is kept.
    """
    clips, parts, stop = [], [], 0
    for clip, first, last in kept:
        parts.append(np.arange(clip.start + first, clip.start + last))
        clips.append(clip.part(first, last, stop, database.fps))
        stop += last - first
    if not clips:
        raise DatabaseError("no clip is left", where=str(database.path), advice="leave out fewer clips")
    frames = np.concatenate(parts)
    if graph is None and stop >= LARGE_DATABASE:
        graph = GraphSettings()
    rotations = np.concatenate([database.local_rotations(part).astype(np.float32) for part in parts])
    write_database(path, database.fps, rotations, database.root_positions_m[frames], clips, database.skeletons, graph)
    return open_database(path)
