"""Recorded poses of databases, as the training samples them."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from perfanim.core.body.mirroring import mirrored_rotations
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.database.store import Database, pose_from_rotations, rotations_from_pose
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, FloatArray, IntArray

_MEAN_SAMPLES = 20_000
_CHUNK = 4096


@dataclass(frozen=True)
class Recordings:
    """All frames of some subjects.

    Args:
        world: (F, J, 3, 3) float32 world rotations; they do not depend on the lengths of bones.
        root_positions_m: (F, 3) float32.
        poses: (F, J - 1, 3) float32 relative to `mean_rotations`, which are their own mirror image.
        starts, stops: (F,) of each frame's clip.
        skeletons: bodies of the subjects.
        skeleton_of_frame: (F,).
        subject_of_frame: (F,) index into `subjects`.
    """

    fps: float
    world: FloatArray
    root_positions_m: FloatArray
    poses: FloatArray
    mean_rotations: Array
    starts: IntArray
    stops: IntArray
    skeletons: tuple[Skeleton, ...]
    skeleton_of_frame: IntArray
    subject_of_frame: IntArray
    subjects: tuple[str, ...]


def read_recordings(
    databases: Sequence[Database], chosen: Collection[str], mean_rotations: Array | None = None
) -> Recordings:
    """Return all frames of the chosen subjects.

    Args:
        mean_rotations: default the mean of the frames and their mirror images.
    """
    local, positions, starts, stops, of_frame = [], [], [], [], []
    skeletons: list[Skeleton] = []
    subjects: list[str] = []
    count = 0
    for database in databases:
        for clip in database.clips:
            if clip.subject not in chosen or clip.mirrored:
                continue
            length = clip.stop - clip.start
            frames = slice(clip.start, clip.stop)
            turned = rotations_from_pose(
                np.array(database.poses[frames], dtype=np.float64),
                database.mean_rotations,
                database.root_rotations[frames],
            )
            local.append(turned.astype(np.float32))
            positions.append(np.array(database.root_positions_m[clip.start : clip.stop], dtype=np.float32))
            starts.append(np.full(length, count))
            stops.append(np.full(length, count + length))
            of_frame.append(np.full(length, len(skeletons) + clip.skeleton))
            subjects += [clip.subject] * length
            count += length
        skeletons += database.skeletons
    rotations = np.concatenate(local)
    if mean_rotations is None:
        some = rotations[:: max(1, len(rotations) // _MEAN_SAMPLES)]
        mean_rotations = rot.mean(np.concatenate((some, mirrored_rotations(some))))
    names = tuple(sorted(set(subjects)))
    parents = skeletons[0].parents
    poses = np.concatenate(
        [pose_from_rotations(rotations[i : i + _CHUNK], mean_rotations) for i in range(0, count, _CHUNK)]
    ).astype(np.float32)
    return Recordings(
        databases[0].fps,
        _world_matrices(rotations, parents),
        np.concatenate(positions),
        poses,
        mean_rotations,
        np.concatenate(starts),
        np.concatenate(stops),
        tuple(skeletons),
        np.concatenate(of_frame),
        np.array([names.index(name) for name in subjects]),
        names,
    )


def _world_matrices(rotations: FloatArray, parents: IntArray) -> FloatArray:
    world = np.empty((*rotations.shape[:2], 3, 3), dtype=np.float32)
    for joint in range(rotations.shape[1]):
        local = rot.to_matrix(rotations[:, joint])
        world[:, joint] = local if joint == 0 else world[:, parents[joint]] @ local
    return world
