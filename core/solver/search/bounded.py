"""Exhaustive search that computes only the distances that may count.

By the Cauchy-Schwarz inequality, the strongest principal components of two poses and the lengths of what they leave out
bound the distance of the poses from below. Frames with a bound beyond the distances of those found last, or of the
likeliest, are left out. So the frames found are those of the exhaustive search, and most poses are never read.
"""

import numpy as np
from scipy.linalg.blas import sgemm

from ...geometry.arrays import Array, FloatArray, IntArray
from ..principal_components import principal_components
from .exhaustive import ExhaustiveSearch, Query, closest, times

_COMPONENTS = 16
_SAMPLES = 4096  # frames that the components are taken from
_MOST = 0.125  # of all frames: how many bounds may leave
_ROUNDING = 1e-5  # of the query's own squares: error of bounds in float32


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
        self._pose_norms = self._frames.pose_norms
        rest = np.sqrt(np.maximum(self._pose_norms - np.einsum("fc,fc->f", strongest, strongest), 0.0))
        squares = np.einsum("fmc,fmc->fm", markers_m, markers_m)
        parts = (squares, markers_m.reshape(len(markers_m), -1), strongest, rest[:, None])
        self._rows = np.concatenate(parts, axis=1)
        self.visited = 0

    def nearest(self, query: Query, count: int, start: IntArray | None = None) -> tuple[IntArray, Array]:
        """Return the `count` closest frames (ascending) and their Eq. 2 distances."""
        self.visited += len(self._rows)
        if query.pose is None or query.pose_weight <= 0.0 or count >= len(self._rows):
            return self._frames.nearest(query, count)
        bounds, rounding = self._bounds(query, query.pose)
        likely = start if start is not None and len(start) >= count else np.argpartition(bounds, count - 1)[:count]
        limit = float(self._frames.distances(query, likely).max()) + rounding
        frames = np.flatnonzero(bounds <= limit)
        if len(frames) > _MOST * len(bounds):  # single rows cost more than all in their order
            return self._frames.nearest(query, count)
        chosen, distances = closest(self._frames.distances(query, frames), count)
        return frames[chosen], distances

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return the candidate frames by their Eq. 2 distances, ascending, and these."""
        return self._frames.nearest_among(query, candidates)

    def _bounds(self, query: Query, pose: Array) -> tuple[FloatArray, float]:
        """Return lower bounds (F,) of the Eq. 2 distances, and their error of rounding."""
        seen = np.isfinite(query.markers_m[:, 0])
        target = np.where(seen[:, None], query.markers_m, 0.0)
        strongest = pose @ self._components
        square = float(pose @ pose)
        rest = np.sqrt(max(square - float(strongest @ strongest), 0.0))
        across = -2.0 * np.concatenate(
            (query.marker_weight * target.ravel(), query.pose_weight * np.append(strongest, rest))
        )
        factors = np.concatenate((query.marker_weight * seen, across)).astype(np.float32)
        squares = query.marker_weight * float(np.sum(target**2)) + query.pose_weight * square
        bounds = times(self._rows, factors)
        bounds += np.float32(query.pose_weight) * self._pose_norms
        bounds += np.float32(squares)
        return bounds, _ROUNDING * squares
