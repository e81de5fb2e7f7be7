"""Exhaustive search that computes only the distances that may count.

By the Cauchy-Schwarz inequality, the strongest principal components of two poses and the lengths of what they leave out
bound the distance of the poses from below. Frames with a bound beyond the distances of those found last, or of the
likeliest, are left out. So the frames found are those of the exhaustive search, and most poses are never read.

From one query to the next the root of a distance changes by no more than the queries are apart (triangle inequality).
Frames that were far from an earlier query by more than that need no new bound.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import sgemm

from ...geometry.arrays import Array, FloatArray, IntArray
from ..principal_components import principal_components
from .exhaustive import ExhaustiveSearch, Query, closest, times

_COMPONENTS = 16
_SAMPLES = 4096  # frames that the components are taken from
_NEAR = 0.125  # of all frames: about how many are kept for the queries after, and most that bounds may leave
_NEAR_SAMPLE = 16  # one in so many frames shows how far these reach
_ROUNDING = 1e-5  # of the query's own squares: error of bounds in float32


@dataclass(frozen=True)
class _Near:
    """Frames near a query.

    Args:
        query: all others are further than `reach` from it, a root of an Eq. 2 distance.
        frames: (N,) their indices.
        rows: (N, R) theirs of `BoundedSearch`.
    """

    query: Query
    reach: float
    frames: IntArray
    rows: FloatArray

    def holds(self, query: Query, limit: float) -> bool:
        """Return whether all frames within an Eq. 2 distance of a query are here."""
        earlier = self.query
        if query.pose is None or earlier.pose is None or query.marker_weight != earlier.marker_weight:
            return False
        moved, turned = (query.markers_m - earlier.markers_m).ravel(), query.pose - earlier.pose
        seen = np.isfinite(moved)
        # markers that were hidden then only add to distances; those hidden since do not
        if query.pose_weight != earlier.pose_weight or seen.sum() != np.isfinite(earlier.markers_m).sum():
            return False
        square = query.marker_weight * (moved[seen] @ moved[seen]) + query.pose_weight * (turned @ turned)
        return bool(np.sqrt(limit) + np.sqrt(square) < self.reach)


class BoundedSearch:
    """Finds the frames of `ExhaustiveSearch` with fewer distances.

    Frames may change places where their distances differ by the rounding of float32 only.

    Args:
        markers_m, poses: as of `ExhaustiveSearch`.
    """

    def __init__(self, markers_m: FloatArray, poses: FloatArray) -> None:
        self._frames = ExhaustiveSearch(markers_m, poses)
        sample = poses[:: max(1, len(poses) // _SAMPLES)].astype(np.float64)
        self._components = principal_components(sample, _COMPONENTS).astype(np.float32)
        strongest = np.asarray(sgemm(1.0, self._components.T, np.asarray(poses).T)).T
        rest = np.sqrt(np.maximum(self._frames.pose_norms - np.einsum("fc,fc->f", strongest, strongest), 0.0))
        squares = np.einsum("fmc,fmc->fm", markers_m, markers_m)
        lengths = np.column_stack((rest, self._frames.pose_norms))
        self._rows = np.concatenate((squares, markers_m.reshape(len(markers_m), -1), strongest, lengths), axis=1)
        self._near: _Near | None = None
        self.visited = 0

    def nearest(self, query: Query, count: int, start: IntArray | None = None) -> tuple[IntArray, Array]:
        """Return the `count` closest frames (ascending) and their Eq. 2 distances."""
        self.visited += len(self._rows)
        if query.pose is None or query.pose_weight <= 0.0 or count >= len(self._rows):
            return self._frames.nearest(query, count)
        factors, squares = self._factors(query, query.pose)
        rounding, bounds = _ROUNDING * squares, None
        if start is None or len(start) < count:
            bounds = times(self._rows, factors) + np.float32(squares)
            start = np.argpartition(bounds, count - 1)[:count]
        limit = float(self._frames.distances(query, start).max()) + rounding
        near = self._near
        if near is None or not near.holds(query, limit):
            bounds = times(self._rows, factors) + np.float32(squares) if bounds is None else bounds
            near = self._near = self._near_frames(query, bounds, limit, rounding)
            if near is None:  # single rows cost more than all in their order
                return self._frames.nearest(query, count)
        frames = near.frames[times(near.rows, factors) <= np.float32(limit - squares)]
        chosen, distances = closest(self._frames.distances(query, frames), count)
        return frames[chosen], distances

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return the candidate frames by their Eq. 2 distances, ascending, and these."""
        return self._frames.nearest_among(query, candidates)

    def _factors(self, query: Query, pose: Array) -> tuple[FloatArray, float]:
        """Return factors (R,) of the rows and a summand: with both, they are lower bounds."""
        seen = np.isfinite(query.markers_m[:, 0])
        target = np.where(seen[:, None], query.markers_m, 0.0)
        strongest = pose @ self._components
        square = float(pose @ pose)
        rest = np.sqrt(max(square - float(strongest @ strongest), 0.0))
        by_pose = query.pose_weight * np.concatenate((-2.0 * strongest, (-2.0 * rest, 1.0)))
        factors = np.concatenate((query.marker_weight * seen, -2.0 * query.marker_weight * target.ravel(), by_pose))
        return factors.astype(np.float32), query.marker_weight * float(np.sum(target**2)) + query.pose_weight * square

    def _near_frames(self, query: Query, bounds: FloatArray, limit: float, rounding: float) -> _Near | None:
        """Return the frames that may be near a query; None if these are too many."""
        sample = bounds[::_NEAR_SAMPLE]
        kept = int(_NEAR * len(sample))
        farthest = float(np.partition(sample, kept)[kept])
        if farthest < limit:
            return None
        frames = np.flatnonzero(bounds <= farthest)
        return _Near(query, float(np.sqrt(max(farthest - rounding, 0.0))), frames, self._rows[frames])
