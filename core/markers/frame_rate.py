"""Frame rate from time stamps."""

import numpy as np

from ..errors import TakeError
from ..geometry.arrays import Array, IntArray


def frame_rate(times_s: Array, numbers: IntArray | None = None) -> float:
    """Return the frames per second of ascending times, rounded if almost whole.

    Args:
        times_s: (F,) of the frames; those that are not finite are left out.
        numbers: (F,) of the frames, where some may be missing; None: they follow each other.

    Raises:
        TakeError: there are not two frames with times that differ.
    """
    steps = np.diff(times_s[np.isfinite(times_s)]) if numbers is None else np.diff(times_s) / np.diff(numbers).clip(1)
    steps = steps[np.isfinite(steps)]
    step = float(np.median(steps)) if len(steps) else 0.0
    if not step > 0.0:
        raise TakeError("has too few frames to have a rate")
    fps = 1.0 / step
    return float(round(fps)) if fps > 0.5 and abs(fps - round(fps)) < 0.02 * max(1.0, fps / 100.0) else fps
