"""Recorded poses from databases, as sampled in training."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from perfanim.core.body.mirroring import mirrored_rotations
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.database.store import Database, pose_from_rotations, rotations_from_pose
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, FloatArray, IntArray

_MEAN_SAMPLES = 20_000
_CHUNK = 4096


class Recordings(NamedTuple):
    """All frames (F) of some subjects."""

    fps: float
    world: FloatArray  # (F, J, 3, 3) world rotations, which do not depend on the bone lengths
    root_positions_m: FloatArray  # (F, 3)
    poses: FloatArray  # (F, J - 1, 3) relative to `mean_rotations`
    mean_rotations: Array  # they are their own mirror image
    starts: IntArray  # (F,) first frame of each frame's clip
    stops: IntArray  # (F,) end of each frame's clip
    skeletons: tuple[Skeleton, ...]
    skeleton_of_frame: IntArray
    subject_of_frame: IntArray  # (F,) index into `subjects`
    subjects: tuple[str, ...]


def read_recordings(
    databases: Sequence[Database], chosen: Collection[str], mean_rotations: Array | None = None
) -> Recordings:
    """Return all frames of the chosen subjects.

    Args:
        mean_rotations: Rotations that poses are relative to; by default the mean of the frames and their mirror images.
    """
    local, positions, lengths, of_clip = [], [], [], []
    skeletons: list[Skeleton] = []
    subjects: list[str] = []
    for database in databases:
        for clip in database.clips:
            if clip.subject not in chosen or clip.mirrored:
                continue
            frames = slice(clip.start, clip.stop)
            poses = np.array(database.poses[frames], dtype=np.float64)
            turned = rotations_from_pose(poses, database.mean_rotations, database.root_rotations[frames])
            local.append(turned.astype(np.float32))
            positions.append(np.array(database.root_positions_m[frames], dtype=np.float32))
            lengths.append(clip.stop - clip.start)
            of_clip.append(len(skeletons) + clip.skeleton)
            subjects.append(clip.subject)
        skeletons += database.skeletons
    rotations = np.concatenate(local)
    if mean_rotations is None:
        some = rotations[:: max(1, len(rotations) // _MEAN_SAMPLES)]
        mean_rotations = rot.mean(np.concatenate((some, mirrored_rotations(some))))
    names = tuple(sorted(set(subjects)))
    chunks = (rotations[i : i + _CHUNK] for i in range(0, len(rotations), _CHUNK))
    stops = np.cumsum(lengths)
    return Recordings(
        databases[0].fps,
        _world_matrices(rotations, skeletons[0].parents),
        np.concatenate(positions),
        np.concatenate([pose_from_rotations(chunk, mean_rotations) for chunk in chunks]).astype(np.float32),
        mean_rotations,
        np.repeat(stops - lengths, lengths),
        np.repeat(stops, lengths),
        tuple(skeletons),
        np.repeat(of_clip, lengths),
        np.repeat([names.index(name) for name in subjects], lengths),
        names,
    )


def _world_matrices(rotations: FloatArray, parents: IntArray) -> FloatArray:
    world = np.empty((*rotations.shape[:2], 3, 3), dtype=np.float32)
    for joint in range(rotations.shape[1]):
        local = rot.to_matrix(rotations[:, joint])
        world[:, joint] = local if joint == 0 else world[:, parents[joint]] @ local
    return world
