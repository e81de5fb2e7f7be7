"""Markers that a live source repeats: they stand exactly still while the body moves."""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, Mask

STILL_M = 1e-7  # movement in a frame that rounding in conversions explains


@dataclass(frozen=True)
class FrozenSettings:
    """Settings of `FrozenMarkers`."""

    least_s: float = 0.1  # time for which a frozen marker stands still
    moved_m: float = 0.05  # length of the body's path meanwhile


_S = FrozenSettings()
_ROUNDING_S = 1e-6  # of a sum of frame intervals


class FrozenMarkers:
    """Finds the frozen markers of one body, frame by frame.

    Recorded takes have more evidence, see `label_faults`.

    Args:
        standing: Mask (M,) of the markers that may stand still, those on feet.
    """

    def __init__(self, standing: Mask) -> None:
        self._standing = standing
        self._last_m = np.full((len(standing), 3), np.nan)
        self._still_s, self._moved_m = np.zeros((2, len(standing)))

    def step(self, points_m: Array, elapsed_s: float) -> Mask:
        """Return a mask (M,) of the markers that are frozen in the next frame.

        Args:
            points_m: Markers (M, 3), NaN where hidden.
            elapsed_s: Time since the last frame.
        """
        steps_m = np.linalg.norm(points_m - self._last_m, axis=1)
        self._last_m = points_m
        known = np.isfinite(steps_m)
        path_m = float(np.median(steps_m[known])) if known.any() else 0.0
        still = steps_m <= STILL_M
        self._still_s = np.where(still, self._still_s + elapsed_s, 0.0)
        self._moved_m = np.where(still, self._moved_m + path_m, 0.0)
        return np.asarray(~self._standing & (self._still_s > _S.least_s - _ROUNDING_S) & (self._moved_m > _S.moved_m))
