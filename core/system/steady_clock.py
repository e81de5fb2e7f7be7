"""Time stamps of a camera's images without their random delays."""

from collections import deque

import numpy as np

_REMEMBERED = 60
_FEWEST = 8
_ASTRAY = 0.3  # periods: a stamp so far from the line is of a camera that runs otherwise now


class SteadyClock:
    """Fits a line through the latest time stamps of a camera.

    Cameras take images at a steady rate; stamps come late by random delays.
    """

    def __init__(self) -> None:
        self._stamps_s: deque[float] = deque(maxlen=_REMEMBERED)
        self._counts: deque[int] = deque(maxlen=_REMEMBERED)

    def steady(self, stamp_s: float) -> float:
        """Return the time of the next image; its stamp until the rate is known."""
        period_s = float(np.median(np.diff(self._stamps_s))) if len(self._stamps_s) > 1 else 0.0
        passed = round((stamp_s - self._stamps_s[-1]) / period_s) if period_s > 0.0 else 1
        self._counts.append(self._counts[-1] + max(passed, 1) if self._counts else 0)
        self._stamps_s.append(stamp_s)
        if len(self._stamps_s) < _FEWEST:
            return stamp_s
        counts, stamps = np.array(self._counts, dtype=np.float64), np.array(self._stamps_s)
        centred = counts - counts.mean()
        rate_s = float(centred @ stamps / (centred @ centred))
        time_s = float(stamps.mean() + rate_s * centred[-1])
        if abs(time_s - stamp_s) > _ASTRAY * rate_s:
            self._stamps_s.clear()
            self._counts.clear()
            self._stamps_s.append(stamp_s)
            self._counts.append(0)
            return stamp_s
        return time_s
