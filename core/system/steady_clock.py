"""Time stamps of a camera's images without their random delays."""

from collections import deque
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SteadyClockSettings:
    """Settings for fitting time stamps."""

    stamps: int = 60  # number of latest stamps that are fitted
    fewest: int = 8  # number of stamps before the fit is used
    astray: float = 0.3  # deviation from the fit, in periods, that means that the camera's rate has changed


_SETTINGS = SteadyClockSettings()


class SteadyClock:
    """Fits a line to the latest time stamps of a camera.

    Cameras take images at a steady rate, but stamps are late by random delays.
    """

    def __init__(self) -> None:
        self._stamps_s: deque[float] = deque(maxlen=_SETTINGS.stamps)
        self._counts: deque[int] = deque(maxlen=_SETTINGS.stamps)

    def steady(self, stamp_s: float) -> float:
        """Return the smoothed time of the next image, given its stamp; the stamp itself until the rate is known."""
        period_s = float(np.median(np.diff(self._stamps_s))) if len(self._stamps_s) > 1 else 0.0
        passed = round((stamp_s - self._stamps_s[-1]) / period_s) if period_s > 0.0 else 1
        self._counts.append(self._counts[-1] + max(passed, 1) if self._counts else 0)
        self._stamps_s.append(stamp_s)
        if len(self._stamps_s) < _SETTINGS.fewest:
            return stamp_s
        counts, stamps = np.array(self._counts, dtype=np.float64), np.array(self._stamps_s)
        centred = counts - counts.mean()
        rate_s = float(centred @ stamps / (centred @ centred))
        time_s = float(stamps.mean() + rate_s * centred[-1])
        if abs(time_s - stamp_s) > _SETTINGS.astray * rate_s:
            self._stamps_s.clear()
            self._counts.clear()
            self._stamps_s.append(stamp_s)
            self._counts.append(0)
            return stamp_s
        return time_s
