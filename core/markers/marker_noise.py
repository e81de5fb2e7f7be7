"""Noise of each marker, from its trajectory alone.

Bodies move smoothly: a cubic through four positions predicts a fifth to a fraction of a millimetre at 60 Hz.
What differs is noise. The median over time leaves out the moments at which the body did accelerate suddenly.
"""

from collections import deque

import numpy as np

from ..geometry.arrays import Array

_POSITIONS = 5  # that are compared
_MEDIAN_LENGTH = 1.538  # of a vector of three standard normal coordinates (chi distribution)
_LATEST_S = 1.0
_FEWEST = 10  # comparisons of a marker; with fewer it is taken as the others


class MarkerNoise:
    """Estimates the noise of markers while they are captured, from the last second."""

    def __init__(self) -> None:
        self._times_s: deque[float] = deque(maxlen=_POSITIONS)
        self._points_m: deque[Array] = deque(maxlen=_POSITIONS)
        self._differences: deque[tuple[float, Array]] = deque()

    def step(self, time_s: float, points_m: Array) -> Array:
        """Return the standard deviation (M,) of each marker's coordinates, metres.

        Args:
            points_m: (M, 3), NaN where a marker was not located.

        Returns:
            0 while unknown; where one marker is unknown, the median of the others.
        """
        self._times_s.append(time_s)
        self._points_m.append(points_m)
        if len(self._times_s) == _POSITIONS:
            self._differences.append((time_s, _differences(np.array(self._times_s), np.array(self._points_m))))
        while self._differences and not 0.0 <= time_s - self._differences[0][0] <= _LATEST_S:
            self._differences.popleft()
        return _sigmas(np.array([row for _, row in self._differences]).reshape(-1, len(points_m)))


def marker_noise(times_s: Array, points_m: Array) -> Array:
    """Return the same for positions (F, M, 3) of a take at ascending times (F,)."""
    starts = range(len(times_s) - _POSITIONS + 1)
    rows = [_differences(times_s[i : i + _POSITIONS], points_m[i : i + _POSITIONS]) for i in starts]
    return _sigmas(np.array(rows).reshape(-1, points_m.shape[1]))


def _differences(times_s: Array, points_m: Array) -> Array:
    """Return distances (M,) of markers from a cubic, of one position's variance.

    The weights are those of a divided difference (Newton), scaled to keep the variance of independent noise.
    """
    apart = times_s[:, None] - times_s
    np.fill_diagonal(apart, 1.0)
    weights = 1.0 / np.prod(apart, axis=1)
    return np.asarray(np.linalg.norm(np.tensordot(weights / np.linalg.norm(weights), points_m, 1), axis=-1))


def _sigmas(differences: Array) -> Array:
    """Return standard deviations (M,) from differences (N, M), NaN where unknown."""
    ordered = np.sort(differences, axis=0)  # NaN last
    counts = np.isfinite(differences).sum(axis=0)
    known = counts >= _FEWEST
    if not known.any():  # soon after the start: all together
        return np.full(len(counts), np.nanmedian(differences) / _MEDIAN_LENGTH if counts.sum() >= _FEWEST else 0.0)
    middle = np.maximum(counts - 1, 0)
    low, high = (np.take_along_axis(ordered, index[None], axis=0)[0] for index in (middle // 2, (middle + 1) // 2))
    sigmas = 0.5 * (low + high) / _MEDIAN_LENGTH
    return np.where(known, sigmas, np.median(sigmas[known]))
