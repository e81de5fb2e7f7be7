"""One frame of every cluster of poses, in groups of similar ones."""

import numpy as np
from numpy.typing import NDArray

from ...database.graph import k_means, weigh_poses
from ...geometry.arrays import FloatArray, IntArray

_SAMPLED = 16  # frames of a cluster, evenly through it, of which the most central stands for it


class ClusterRepresentatives:
    """Frames that stand for the clusters of a database.

    Args:
        poses: (F, D) poses of the database frames.
        clusters: (F,) cluster of each frame, none empty.

    Attributes:
        frames: (C,) one of each cluster.
        groups: the same frames in about sqrt(C) groups.
        leaders: (G,) the most central frame of each group.
    """

    def __init__(self, poses: FloatArray, clusters: NDArray[np.int32]) -> None:
        order = np.argsort(clusters, kind="stable")
        counts = np.bincount(clusters)
        starts = np.cumsum(counts) - counts
        shares = (np.arange(_SAMPLED) + 0.5) / _SAMPLED
        sampled = order[starts[:, None] + (counts[:, None] * shares).astype(np.int64)]
        away = weigh_poses(poses[sampled])
        away -= away.mean(axis=1, keepdims=True)
        central = np.argmin(np.einsum("csd,csd->cs", away, away), axis=1)
        self.frames: IntArray = sampled[np.arange(len(counts)), central]
        mine = weigh_poses(poses[self.frames])
        centres, group = k_means(mine, round(np.sqrt(len(mine))))
        self.groups = [self.frames[group == index] for index in range(len(centres))]
        away = mine - centres[group]
        apart = np.einsum("cd,cd->c", away, away)
        self.leaders: IntArray = np.array(
            [self.frames[group == index][np.argmin(apart[group == index])] for index in range(len(centres))]
        )
