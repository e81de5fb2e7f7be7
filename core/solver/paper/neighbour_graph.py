"""Neighbour graph of a motion database (Eq. 4), built from coarse clusters.

The paper joins any two frames closer than a threshold, so its graph grows with the square of the density. Here every
frame keeps a bounded number of neighbours: the frames before and after it, then the closest ones, but only one for each
time that a clip passes by. Neighbours are searched for within coarse clusters of poses and the clusters next to them,
not among all pairs. In distances, each joint is weighted by how far it moves head, hands and feet, because the search
compares markers (Eq. 2).
"""

import os
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...body.standard_skeleton import default_skeleton
from ...database.k_means import centres_of, nearest_centres
from ...geometry.arrays import FloatArray

IntArray = NDArray[np.int32]

_NEIGHBOURS = 24  # number of neighbours of a frame
_ONE_CLUSTER = 2048  # number of frames up to which all pairs are compared
_MOST_COMPARED = 4096  # largest number of frames with which a cluster's frames are compared; more are thinned out
_CLUSTERS_PER_ROOT = 2.0  # number of clusters relative to the square root of the number of frames
_BESIDE = 3  # number of further clusters in which a frame's neighbours are searched for
_STRETCH = 4  # length, in candidates, of the stretches of a pass; the closest frame of each is considered
_STRETCHES_PER_NEIGHBOUR = 4  # fewest stretches per neighbour; with fewer, every frame is its own stretch
_SAME_PASS = np.float32(1e6)  # penalty for frames that are not a local minimum of the distance, squared radians
_NEVER = np.float32(1e30)  # squared distance of excluded frames; infinity would turn matrix products into NaN
_BLOCK = 1 << 20  # number of distances that each thread holds at once
_EXTREMITIES = ("head", "lhumerus", "lhand", "rhumerus", "rhand", "lfoot", "rfoot")
_OWN_WEIGHT = 0.1  # weight of a joint's rotation in addition to that of the extremities it moves, m^2 per rad^2


@dataclass(frozen=True)
class NeighbourGraph:
    """Neighbours and clusters of all frames.

    Args:
        neighbours: Frame indices (F, N), -1 where there are fewer.
        clusters: Cluster (F,) of each frame, numbered from 0 without gaps.
    """

    neighbours: IntArray
    clusters: IntArray


def weigh_poses(poses: FloatArray) -> FloatArray:
    """Scale poses (..., D) so that their L2 distance is about that of their markers, metres."""
    skeleton = default_skeleton()
    positions = skeleton.rest_positions_m
    moved = np.full(len(skeleton), _OWN_WEIGHT)
    for name in _EXTREMITIES:
        extremity = joint = skeleton.names.index(name)
        while joint > 0:
            moved[joint] += np.sum((positions[extremity] - positions[joint]) ** 2)
            joint = skeleton.parents[joint]
    return poses * np.repeat(np.sqrt(moved[1:]), 3).astype(np.float32)


def build_graph(poses: FloatArray, clip_of_frame: NDArray[Any], most: int = _NEIGHBOURS) -> NeighbourGraph:
    """Return the neighbour graph of poses.

    Args:
        poses: Float32 rotation vectors (F, D) relative to the reference pose.
        clip_of_frame: Clip (F,) of each frame; successive frames of a clip are always joined.
        most: Number of neighbours kept per frame, at least 2, however far away they are. Eq. 4 only joins those within
            a radius, which isolates unusual motion; with as many visits, the search came 2.6 times as close to the
            exhaustive one this way.
    """
    scaled = weigh_poses(poses)
    neighbours = np.full((len(poses), most), -1, dtype=np.int32)
    _join_consecutive(neighbours, clip_of_frame)
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # NumPy releases the GIL
        centres = _centres(scaled, threads)
        used, clusters = np.unique(nearest_centres(scaled, centres, threads.map), return_inverse=True)
        clusters = clusters.reshape(-1)
        members = np.split(np.argsort(clusters, kind="stable"), np.cumsum(np.bincount(clusters))[:-1])
        beside = _clusters_beside(centres[used])

        def join(own: int) -> None:
            columns = np.sort(np.concatenate([members[cluster] for cluster in (own, *beside[own])]))
            stride = max(1, -(-len(columns) // _MOST_COMPARED))
            candidates = _Candidates(scaled, columns[::stride], stride, most - 2)
            rows_at_once = max(1, _BLOCK // len(columns))
            for start in range(0, len(members[own]), rows_at_once):
                rows = members[own][start : start + rows_at_once]
                found = candidates.closest(rows)
                neighbours[rows, 2 : 2 + found.shape[1]] = found

        for _ in threads.map(join, range(len(members))):
            pass
    return NeighbourGraph(neighbours, clusters.astype(np.int32))


def _centres(poses: FloatArray, threads: Executor) -> FloatArray:
    """Return the centres (C, D) of coarse clusters."""
    if len(poses) <= _ONE_CLUSTER:
        return np.mean(poses, axis=0, keepdims=True)
    return centres_of(poses, int(_CLUSTERS_PER_ROOT * np.sqrt(len(poses))), threads.map)


def _clusters_beside(centres: FloatArray) -> NDArray[np.int64]:
    """Return the indices (C, n) of the other clusters closest to each cluster."""
    norms = np.einsum("cd,cd->c", centres, centres)
    distances = norms - 2.0 * (centres @ centres.T) + norms[:, None]
    np.fill_diagonal(distances, np.inf)
    return np.argsort(distances, axis=1)[:, : min(_BESIDE, len(centres) - 1)]


def _join_consecutive(neighbours: IntArray, clip_of_frame: NDArray[Any]) -> None:
    """Write each frame's predecessor and successor to the first two columns."""
    frames = np.arange(len(neighbours), dtype=np.int32)
    joined = np.asarray(clip_of_frame[1:]) == np.asarray(clip_of_frame[:-1])
    neighbours[1:, 0] = np.where(joined, frames[:-1], -1)
    neighbours[:-1, 1] = np.where(joined, frames[1:], -1)


class _Candidates:
    """Candidates for neighbours, with which the frames of a cluster are compared.

    Args:
        frames: Candidates (C,), ascending.
        stride: Largest difference between two successive candidates in one pass of a clip.
    """

    def __init__(self, poses: FloatArray, frames: NDArray[np.int64], stride: int, most: int) -> None:
        self._poses = poses
        self._most = min(most, len(frames))
        self._length = _STRETCH if len(frames) > _STRETCHES_PER_NEIGHBOUR * _STRETCH * most else 1
        # passes are cut into stretches of equal length; the last stretch of a pass is padded with its last frame
        last = np.diff(frames, append=frames[-1] + stride + 1) > stride
        lacking = -np.diff(np.flatnonzero(last), prepend=-1) % self._length
        copies = np.ones(len(frames), dtype=np.int64)
        copies[last] += lacking
        self._frames = np.repeat(frames, copies)
        self._goes_on = ~np.repeat(last, copies)[self._length - 1 : -1 : self._length]
        near = poses[self._frames]
        self._origin = near.mean(axis=0)  # rounding errors are smaller for numbers near zero
        near -= self._origin
        squares = np.einsum("cd,cd->c", near, near)
        squares[1:][self._frames[1:] == self._frames[:-1]] = _NEVER  # copies of a frame are excluded
        self._near = np.column_stack((near, squares))

    def closest(self, rows: NDArray[np.int64]) -> IntArray:
        """Return the candidates (R, most or all) closest to each frame, closest first, padded with -1.

        Each is from a different pass if there are enough passes. A frame itself, its predecessor and its successor are
        excluded.
        """
        mine = self._poses[rows] - self._origin
        # without the squared length of `mine`, which is the same for all candidates
        distances = self._near @ np.column_stack((-2.0 * mine, np.ones(len(rows), dtype=np.float32))).T
        for step in (-1, 0, 1):
            places = np.minimum(np.searchsorted(self._frames, rows + step), len(self._frames) - 1)
            own = np.flatnonzero(self._frames[places] == rows + step)
            distances[places[own], own] = _NEVER
        stretches = distances.reshape(-1, self._length, len(rows))
        chosen = self._closest_stretches(stretches)
        within = stretches[chosen, :, np.arange(len(rows))[:, None]]
        best = within.min(axis=2)
        found = self._frames[chosen * self._length + within.argmin(axis=2)].astype(np.int32)
        found[best >= 0.5 * _NEVER] = -1
        return np.take_along_axis(found, np.argsort(best, axis=1), axis=1)

    def _closest_stretches(self, stretches: FloatArray) -> NDArray[np.int64]:
        """Return the stretches (R, most) with the closest frames, in any order."""
        minima = stretches.min(axis=1)
        if len(minima) > self._most:
            falls = minima[1:] < minima[:-1]
            goes_on = self._goes_on[:, None]
            minima[:-1] += _SAME_PASS * (falls & goes_on)
            minima[1:] += _SAME_PASS * (~falls & goes_on)
        return np.argpartition(np.ascontiguousarray(minima.T), self._most - 1, axis=1)[:, : self._most]
