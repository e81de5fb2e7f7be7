"""Seams of trajectories: how well the motion before and after a moment fits together.

A seam is the moment between two successive positions. The trajectory is extrapolated to it along a straight line, from
the two positions before and from the two after. The distance between the two results is the miss, which is zero while
the acceleration is constant. It is compared with the trajectory's typical misses across gaps of the same length, and
with misses around the same time.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, IntArray
from .marker_noise import FEWEST, MEDIAN_LENGTH


@dataclass(frozen=True)
class SeamSettings:
    """Settings for misses, chosen on true trajectories of the CMU subjects 05, 14, 16, 127 and 135."""

    least_m: float = 0.3e-3  # smallest standard deviation of a coordinate, due to rounding and skin motion
    beside: int = 8  # number of seams on either side that show how sudden the motion is there
    gaps: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)  # steps across a seam, in frames, for which misses are measured


_S = SeamSettings()


def before(times_s: Array, points_m: Array) -> Array:
    """Return positions (N - 1, 3) at the seams of N positions, extrapolated from those before; NaN at the first."""
    middle_s = 0.5 * (times_s[1:] + times_s[:-1])
    found = np.full((len(times_s) - 1, 3), np.nan)
    share = (middle_s[1:] - times_s[1:-1]) / (times_s[1:-1] - times_s[:-2])
    found[1:] = points_m[1:-1] + share[:, None] * (points_m[1:-1] - points_m[:-2])
    return found


def after(times_s: Array, points_m: Array) -> Array:
    """Return positions (N - 1, 3) at the seams of N positions, extrapolated from those after; NaN at the last."""
    return before(-times_s[::-1], points_m[::-1])[::-1]


def cost(misses: Array) -> Array:
    """Return the negative log likelihood, nats, of misses in standard deviations: a Cauchy distribution in space."""
    return np.asarray(2.0 * np.log1p(misses * misses))


class SeamScale:
    """Standard deviations (M, by gap) of the misses of a take's trajectories.

    Args:
        times_s: Ascending times (F,).
        points_m: Trajectories (F, M, 3), NaN where hidden.
    """

    def __init__(self, times_s: Array, points_m: Array) -> None:
        frames, markers = points_m.shape[:2]
        self._step_s = float(np.median(np.diff(times_s)))
        self._at_gap = np.full((markers, len(_S.gaps)), np.nan)
        for column, gap in enumerate(_S.gaps):
            if frames < gap + 3 + FEWEST:
                break
            ends = (
                points_m[: frames - gap - 2],
                points_m[1 : frames - gap - 1],
                points_m[gap + 1 : -1],
                points_m[gap + 2 :],
            )
            half = 0.5 * gap
            miss = np.linalg.norm((1 + half) * (ends[1] - ends[2]) - half * (ends[0] - ends[3]), axis=-1)
            known = np.isfinite(miss).sum(axis=0) >= FEWEST
            self._at_gap[known, column] = np.nanmedian(miss[:, known], axis=0) / MEDIAN_LENGTH
        self._complete()

    @property
    def usual(self) -> Array:
        """Standard deviations (M,) of misses between successive frames."""
        return self._at_gap[:, 0]

    def over(self, marker: int, elapsed_s: Array) -> Array:
        """Return the standard deviations of a marker's misses across gaps of given durations."""
        gaps = np.log(np.maximum(elapsed_s / self._step_s, 1.0))
        return np.asarray(np.exp(np.interp(gaps, np.log(_S.gaps), np.log(self._at_gap[marker]))))

    def _complete(self) -> None:
        """Fill unknown entries from other markers or shorter gaps, and make misses grow with the length of the gap."""
        for column in range(len(_S.gaps)):
            known = np.isfinite(self._at_gap[:, column])
            usual = np.median(self._at_gap[known, column]) if known.any() else np.nan
            self._at_gap[~known, column] = usual
        self._at_gap[:, 0] = np.fmax(self._at_gap[:, 0], _S.least_m)
        self._at_gap = np.fmax.accumulate(self._at_gap, axis=1)

    def ratios(self, marker: int, times_s: Array, misses_m: Array) -> Array:
        """Return the misses (N - 1,) at the seams of positions at times (N,), relative to typical misses."""
        return np.asarray(misses_m / self.over(marker, np.diff(times_s)))

    def torn(self, marker: int, times_s: Array, misses_m: Array, least_m: float, sigmas: float) -> IntArray:
        """Return the seams of positions at times (N,) with misses above both limits."""
        ratios = self.ratios(marker, times_s, misses_m)
        at = np.flatnonzero((misses_m > least_m) & (ratios > sigmas))
        return np.asarray(at[ratios[at] > sigmas * sudden(ratios, at)])


def sudden(ratios: Array, at: IntArray) -> Array:
    """Return the factors (K,) by which misses around the seams `at` (K,) exceed typical ones; 1 if they do not.

    Misses that are larger for a while show sudden motion, so the median of the misses around a seam is used.

    Args:
        ratios: `SeamScale.ratios` of a trajectory.
    """
    padded = np.pad(ratios, _S.beside, constant_values=np.nan)
    return np.maximum(medians(padded[at[:, None] + np.arange(2 * _S.beside + 1)]) / MEDIAN_LENGTH, 1.0)


def medians(rows: Array) -> Array:
    """Return the medians (N,) of rows (N, K) without NaN; 0 where all are NaN."""
    ordered = np.sort(rows, axis=1)  # NaNs come last
    counts = np.isfinite(rows).sum(axis=1)
    each: IntArray = np.arange(len(rows))
    middle = 0.5 * (ordered[each, np.maximum(counts - 1, 0) // 2] + ordered[each, counts // 2])
    return np.where(counts > 0, middle, 0.0)
