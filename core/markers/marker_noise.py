"""Noise of each marker, estimated from its trajectory alone.

Bodies move smoothly: a cubic through four positions predicts the next one to a fraction of a millimetre at 60 Hz. The
difference is noise. The median over time ignores sudden accelerations.
"""

from collections import deque

import numpy as np

from ..geometry.arrays import Array

_POSITIONS = 5  # number of successive positions that are compared
MEDIAN_LENGTH = 1.538  # median of the chi distribution with 3 degrees of freedom
_LATEST_S = 1.0  # length of the period from which a live estimate is made
FEWEST = 10  # number of differences needed to estimate their standard deviation


class MarkerNoise:
    """Estimates the noise of each marker from the last second of a capture."""

    def __init__(self) -> None:
        self._times_s: deque[float] = deque(maxlen=_POSITIONS)
        self._points_m: deque[Array] = deque(maxlen=_POSITIONS)
        self._known_s: deque[float] = deque()
        self._differences: Array = np.empty((0, 0))  # one row (M,) for each of these times

    def step(self, time_s: float, points_m: Array) -> Array:
        """Add a frame; return the standard deviation (M,) of each marker's coordinates, metres.

        Args:
            points_m: Markers (M, 3), NaN where hidden.

        Returns:
            0 while unknown; for a marker without an estimate of its own, the median of the others.
        """
        self._times_s.append(time_s)
        self._points_m.append(points_m)
        rows = self._differences.reshape(-1, len(points_m))
        if len(self._times_s) == _POSITIONS:
            row = _differences(np.array(self._times_s), np.array(self._points_m))
            self._known_s.append(time_s)
            rows = np.concatenate((rows, row[None]))
        while self._known_s and not 0.0 <= time_s - self._known_s[0] <= _LATEST_S:
            self._known_s.popleft()
        self._differences = rows[len(rows) - len(self._known_s) :]
        return _sigmas(self._differences)


def marker_noise(times_s: Array, points_m: Array) -> Array:
    """Return the standard deviation (M,) of the coordinates of a take's markers (F, M, 3) at ascending times (F,)."""
    starts = range(len(times_s) - _POSITIONS + 1)
    rows = [_differences(times_s[i : i + _POSITIONS], points_m[i : i + _POSITIONS]) for i in starts]
    return _sigmas(np.array(rows).reshape(-1, points_m.shape[1]))


def _differences(times_s: Array, points_m: Array) -> Array:
    """Return distances (M,) of markers from a cubic, scaled to have the variance of a single position.

    They are Newton's divided differences, with the weights normalised so that independent noise keeps its variance.
    """
    apart = times_s[:, None] - times_s
    apart.flat[:: len(apart) + 1] = 1.0
    weights = 1.0 / np.multiply.reduce(apart, axis=1)
    weights /= np.sqrt(weights @ weights)
    differences = (weights @ points_m.reshape(len(weights), -1)).reshape(points_m.shape[1:])
    return np.asarray(np.sqrt(np.add.reduce(differences * differences, axis=-1)))


def _sigmas(differences: Array) -> Array:
    """Return standard deviations (M,) of coordinates from differences (N, M), NaN where unknown."""
    ordered = np.sort(differences.T)  # NaNs come last
    frames = len(differences)
    if frames >= FEWEST and not np.isnan(ordered[:, -1]).any():
        return np.asarray(0.5 * (ordered[:, (frames - 1) // 2] + ordered[:, frames // 2]) / MEDIAN_LENGTH)
    counts = np.isfinite(differences).sum(axis=0)
    known = counts >= FEWEST
    if not known.any():  # soon after the start, there is one estimate for all markers
        return np.full(len(counts), np.nanmedian(differences) / MEDIAN_LENGTH if counts.sum() >= FEWEST else 0.0)
    middle = np.maximum(counts - 1, 0)
    each = np.arange(len(counts))
    low, high = (ordered[each, index] for index in (middle // 2, (middle + 1) // 2))
    sigmas = 0.5 * (low + high) / MEDIAN_LENGTH
    return np.where(known, sigmas, np.median(sigmas[known]))
