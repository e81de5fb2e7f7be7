"""Search for the database frames closest to the markers and the motion so far (Eq. 2)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Query:
    """What is searched for.

    Args:
        markers_m: (M, 3) markers in the root's frame, NaN where not located.
        pose: (D,) pose that continues the motion, 2 q_{t-1} - q_{t-2}; None at the start.
        marker_weight, pose_weight: factors of the squared distances.
    """

    markers_m: Array
    pose: Array | None
    marker_weight: float
    pose_weight: float


class ExhaustiveSearch:
    """Compares the query with every frame.

    Args:
        markers_m: (F, M, 3) markers of the database frames with the root at rest.
        poses: (F, D) poses of the database frames.
    """

    def __init__(self, markers_m: FloatArray, poses: FloatArray) -> None:
        # columns are contiguous so that a hidden marker's are simply left out
        self._markers = np.ascontiguousarray(markers_m.reshape(len(markers_m), -1))
        self._poses = poses
        self._pose_norms = np.einsum("fd,fd->f", poses, poses)
        self._marker_norms = self._markers**2

    def nearest(self, query: Query, count: int) -> tuple[IntArray, Array]:
        """Return the `count` closest frames (ascending) and their Eq. 2 distances."""
        distances = self.distances(query)
        count = min(count, len(distances))
        chosen = np.argpartition(distances, count - 1)[:count]
        order = np.argsort(distances[chosen], kind="stable")
        return chosen[order], distances[chosen[order]].astype(np.float64)

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return the candidate frames by their Eq. 2 distances, ascending, and these."""
        distances = self.distances(query, candidates)
        order = np.argsort(distances, kind="stable")
        return candidates[order], distances[order].astype(np.float64)

    def distances(self, query: Query, frames: IntArray | slice = slice(None)) -> FloatArray:
        """Return the Eq. 2 distances of frames."""
        seen = np.isfinite(query.markers_m.ravel())
        target = np.where(seen, query.markers_m.ravel(), 0.0).astype(np.float32)
        mask = seen.astype(np.float32)
        result = self._marker_norms[frames] @ mask
        result -= 2.0 * (self._markers[frames] @ target)
        result += target @ target
        result *= np.float32(query.marker_weight)
        if query.pose is not None and query.pose_weight > 0.0:
            pose = query.pose.astype(np.float32)
            between = self._pose_norms[frames] - 2.0 * (self._poses[frames] @ pose) + pose @ pose
            result += np.float32(query.pose_weight) * between
        return result
