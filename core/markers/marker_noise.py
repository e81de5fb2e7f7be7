"""Noise of each marker, estimated from its trajectory alone.

Bodies move smoothly: a cubic through four positions predicts the next one to a fraction of a millimetre at 60 Hz. The
difference is noise. The median over time ignores sudden accelerations.
"""

from collections import deque

import numpy as np

from ..geometry.arrays import Array
from ..kernel.library import address, checked, contiguous, function, stage

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
            row = differences(np.array(self._times_s), np.array(self._points_m))
            self._known_s.append(time_s)
            rows = np.concatenate((rows, row[None]))
        while self._known_s and not 0.0 <= time_s - self._known_s[0] <= _LATEST_S:
            self._known_s.popleft()
        self._differences = rows[len(rows) - len(self._known_s) :]
        return noise(self._differences)


def marker_noise(times_s: Array, points_m: Array) -> Array:
    """Return the standard deviation (M,) of the coordinates of a take's markers (F, M, 3) at ascending times (F,)."""
    starts = range(len(times_s) - _POSITIONS + 1)
    rows = [differences(times_s[i : i + _POSITIONS], points_m[i : i + _POSITIONS]) for i in starts]
    return noise(np.array(rows).reshape(-1, points_m.shape[1]))


_DIFFERENCES, _NOISE = function("differences", "nnppp"), function("noise", "nnndppp")


def _compiled_differences(times_s: Array, points_m: Array) -> Array:
    found = np.empty(points_m.shape[1])
    given = contiguous(times_s), contiguous(points_m)
    checked(_DIFFERENCES(*points_m.shape[:2], *given, address(found)))
    return found


@stage(_compiled_differences)
def differences(times_s: Array, points_m: Array) -> Array:
    """Return distances (M,) of markers from a cubic, scaled to have the variance of a single position.

    They are Newton's divided differences, with the weights normalised so that independent noise keeps its variance.

    Args:
        times_s: Times (5,) of successive positions.
        points_m: Positions (5, M, 3), NaN where unknown.
    """
    apart = times_s[:, None] - times_s
    apart.flat[:: len(apart) + 1] = 1.0
    weights = 1.0 / np.multiply.reduce(apart, axis=1)
    weights /= np.sqrt(weights @ weights)
    found = (weights @ points_m.reshape(len(weights), -1)).reshape(points_m.shape[1:])
    return np.asarray(np.sqrt(np.add.reduce(found * found, axis=-1)))


def _compiled_noise(differences_m: Array) -> Array:
    rows, count = differences_m.shape
    sigmas, work = np.empty(count), np.empty(((rows + 1) * count, 2))
    checked(_NOISE(rows, count, FEWEST, MEDIAN_LENGTH, contiguous(differences_m), address(work), address(sigmas)))
    return sigmas


@stage(_compiled_noise)
def noise(differences_m: Array) -> Array:
    """Return standard deviations (M,) of coordinates, metres, from differences (N, M), NaN where unknown."""
    known_m = np.where(np.isfinite(differences_m), differences_m, np.nan)
    counts = np.isfinite(known_m).sum(axis=0)
    known = counts >= FEWEST
    if not known.any():  # soon after the start, there is one estimate for all markers
        return np.full(len(counts), np.nanmedian(known_m) / MEDIAN_LENGTH if counts.sum() >= FEWEST else 0.0)
    ordered = np.sort(known_m, axis=0)  # NaNs come last
    middle, each = np.maximum(counts - 1, 0), np.arange(len(counts))
    sigmas = 0.5 * (ordered[middle // 2, each] + ordered[(middle + 1) // 2, each]) / MEDIAN_LENGTH
    return np.where(known, sigmas, np.median(sigmas[known]))
