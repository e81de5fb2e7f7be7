"""Exhaustive search for the database frames closest to markers and motion (Eq. 2)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ...geometry.arrays import Array, FloatArray, IntArray


@dataclass(frozen=True)
class Query:
    """Markers and pose to be searched for, with the weights of their squared distances."""

    markers_m: Array  # (M, 3) in the root's frame, NaN where not located
    pose: Array | None  # (D,) pose that continues the motion, 2 q_{t-1} - q_{t-2}; None at the start
    marker_weight: float
    pose_weight: float

    @cached_property
    def single_precision(self) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Markers (3 M,), 0 where hidden, their weights (3 M,), and the pose (D,), None if it has no weight."""
        seen = np.isfinite(self.markers_m.ravel())
        target = np.where(seen, self.markers_m.ravel(), 0.0).astype(np.float32)
        pose = self.pose.astype(np.float32) if self.pose is not None and self.pose_weight > 0.0 else None
        return target, seen * np.float32(self.marker_weight), pose


class Search(Protocol):
    """Interface of searches for the closest database frames.

    Attributes:
        visited: Number of distances computed by `nearest` so far.
    """

    visited: int

    def nearest(self, query: Query, count: int, start: IntArray | None = None) -> tuple[IntArray, Array]:
        """Return the `count` closest frames found, closest first, and their Eq. 2 distances.

        Args:
            start: Distinct frames found in the last search, from which this one may start.
        """

    def near(self, query: Query, count: int, start: IntArray | None = None) -> IntArray:
        """Return the `count` closest frames found, and possibly more, closest first."""

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return the candidate frames and their Eq. 2 distances, sorted by distance."""


class ExhaustiveSearch:
    """Search that compares the query with every frame.

    Args:
        markers_m: Markers (F, M, 3) of the database frames with the root at rest.
        poses: Poses (F, D) of the database frames.

    Attributes:
        pose_norms: Squared lengths (F,) of the poses.
    """

    def __init__(self, markers_m: FloatArray, poses: FloatArray) -> None:
        self._markers = np.ascontiguousarray(markers_m.reshape(len(markers_m), -1))
        self._poses = np.asarray(poses)
        self.pose_norms = np.einsum("fd,fd->f", self._poses, self._poses)
        self.visited = 0

    def __len__(self) -> int:
        return len(self._markers)

    @cached_property
    def marker_norms(self) -> FloatArray:
        """Squares (F, 3 M) of the markers' coordinates.

        They are computed on first use, because distances from a few frames do not need them.
        """
        return np.square(self._markers)

    def nearest(self, query: Query, count: int, start: IntArray | None = None) -> tuple[IntArray, Array]:
        """Return the `count` closest frames, closest first, and their Eq. 2 distances."""
        found, _ = closest(self.distances(query), count)
        self.visited += len(self)
        return self.nearest_among(query, found)  # distances computed frame by frame have smaller rounding errors

    def near(self, query: Query, count: int, start: IntArray | None = None) -> IntArray:
        """Return the `count` closest frames, closest first."""
        return self.nearest(query, count)[0]

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return the candidate frames and their Eq. 2 distances, sorted by distance."""
        order, distances = closest(self.distances(query, candidates), len(candidates))
        return candidates[order], distances

    def distances(self, query: Query, frames: IntArray | slice = slice(None)) -> FloatArray:
        """Return the Eq. 2 distances (K,) of some frames, by default of all."""
        if not isinstance(frames, slice):
            return distances_between(query, self._markers.take(frames, axis=0), self._poses, frames)
        target, weights, pose = query.single_precision
        result = self.marker_norms[frames] @ weights
        result -= self._markers[frames] @ (2.0 * weights * target)
        result += (weights * target) @ target
        if pose is not None:
            between = self.pose_norms[frames] - 2.0 * (self._poses[frames] @ pose) + pose @ pose
            result += np.float32(query.pose_weight) * between
        return result


def distances_between(query: Query, markers_m: FloatArray, poses: FloatArray, frames: IntArray) -> FloatArray:
    """Return the Eq. 2 distances (K,) of frames.

    Args:
        markers_m: Markers (K, 3 M) of these frames; they are overwritten.
        poses: Poses (F, D) of all frames.
    """
    target, weights, pose = query.single_precision
    markers_m -= target
    markers_m *= markers_m
    result = markers_m @ weights
    if pose is not None:
        away = poses.take(frames, axis=0)
        away -= pose
        result += np.float32(query.pose_weight) * np.einsum("fd,fd->f", away, away)
    return result


def closest(distances: FloatArray, count: int) -> tuple[IntArray, Array]:
    """Return the indices of the `count` smallest distances, smallest first, and these distances."""
    count = min(count, len(distances))
    chosen = np.argpartition(distances, count - 1)[:count]
    chosen = chosen[np.argsort(distances[chosen], kind="stable")]
    return chosen, distances[chosen].astype(np.float64)
