"""Frame rate from time stamps."""

import numpy as np

from ..errors import TakeError
from ..geometry.arrays import Array, IntArray


def frame_rate(times_s: Array, numbers: IntArray | None = None) -> float:
    """Return the frames per second of ascending times, rounded if almost whole.

    Args:
        times_s: Times (F,) of the frames; NaN are left out.
        numbers: Numbers (F,) of the frames, if some may be missing.

    Raises:
        TakeError: There are no two frames with different times.
    """
    steps = np.diff(times_s[np.isfinite(times_s)]) if numbers is None else np.diff(times_s) / np.diff(numbers).clip(1)
    steps = steps[np.isfinite(steps)]
    step = float(np.median(steps)) if len(steps) else 0.0
    if not step > 0.0:
        raise TakeError("has too few frames to have a rate")
    fps = 1.0 / step
    return float(round(fps)) if fps > 0.5 and abs(fps - round(fps)) < 0.02 * max(1.0, fps / 100.0) else fps
