"""Prediction of unlabelled points from the last frames."""

import numpy as np
from scipy.spatial.distance import cdist

from ...geometry.arrays import Array
from ...geometry.gated_assignment import assign

_FASTEST_M_S = 12.0
_JITTER_M = 0.05
_FORGET_S = 0.5
_DAMPING = 0.8


class PointPredictor:
    """Constant-velocity prediction of points; forgets them after half a second."""

    def __init__(self) -> None:
        self._points = np.empty((0, 3))
        self._velocities = np.empty((0, 3))
        self._seen_s = np.empty(0)

    def predict(self, time_s: float) -> Array | None:
        """Return expected positions (P, 3), None when nothing is known."""
        if len(self._points) == 0:
            return None
        passed = np.clip(time_s - self._seen_s, 0.0, _FORGET_S)[:, None]
        return np.asarray(self._points + self._velocities * passed)

    def update(self, time_s: float, points_m: Array) -> None:
        """Take the points (N, 3) that were found."""
        points = np.asarray(points_m, dtype=np.float64)
        velocities = np.zeros_like(points)
        kept = time_s - self._seen_s < _FORGET_S
        expected = self.predict(time_s)
        if expected is not None and len(points):
            distance = cdist(points, expected)
            rows, columns = assign(distance, np.inf)
            passed = np.maximum(time_s - self._seen_s[columns], 1e-4)
            near = distance[rows, columns] <= _JITTER_M + _FASTEST_M_S * passed
            rows, columns, passed = rows[near], columns[near], passed[near]
            velocities[rows] = _DAMPING * (points[rows] - self._points[columns]) / passed[:, None]
            kept[columns] = False
        self._points = np.concatenate((points, self._points[kept]))
        self._velocities = np.concatenate((velocities, self._velocities[kept]))
        self._seen_s = np.concatenate((np.full(len(points), time_s), self._seen_s[kept]))
