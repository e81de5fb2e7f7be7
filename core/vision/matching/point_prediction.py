"""Prediction of unlabelled points from the last frames."""

import numpy as np

from ...geometry.arrays import Array
from ...geometry.gated_assignment import assign
from ...geometry.rotations import lengths
from .matching_settings import MATCHING


class PointPredictor:
    """Constant-velocity prediction of points."""

    def __init__(self) -> None:
        self._points = np.empty((0, 3))
        self._velocities = np.empty((0, 3))
        self._seen_s = np.empty(0)

    def predict(self, time_s: float) -> Array | None:
        """Return expected points (P, 3), or None if there are none."""
        if len(self._points) == 0:
            return None
        passed = np.clip(time_s - self._seen_s, 0.0, MATCHING.forget_s)[:, None]
        return np.asarray(self._points + self._velocities * passed)

    def update(self, time_s: float, points_m: Array) -> None:
        """Update the prediction with the points (N, 3) that were found."""
        velocities = np.zeros_like(points_m)
        kept = time_s - self._seen_s < MATCHING.forget_s
        expected = self.predict(time_s)
        if expected is not None and len(points_m):
            distance = lengths(points_m[:, None] - expected)
            rows, columns = assign(distance, np.inf)
            passed = np.maximum(time_s - self._seen_s[columns], 1e-4)
            near = distance[rows, columns] <= MATCHING.jitter_m + MATCHING.fastest_m_s * passed
            rows, columns, passed = rows[near], columns[near], passed[near]
            velocities[rows] = MATCHING.damping * (points_m[rows] - self._points[columns]) / passed[:, None]
            kept[columns] = False
        self._points = np.concatenate((points_m, self._points[kept]))
        self._velocities = np.concatenate((velocities, self._velocities[kept]))
        self._seen_s = np.concatenate((np.full(len(points_m), time_s), self._seen_s[kept]))
