"""Keyframe reduction of densely sampled curves within an error bound.

Between two keys, the curve is the cubic Hermite segment with the recorded values and slopes at the keys; animation
programs represent it as a Bezier curve whose handles reach a third of the way. Where it differs from the recording by
more than the bound, a key is inserted at the worst frame, and both halves are treated likewise (Douglas and Peucker
1973, for polylines). Slopes are those of the recording, so a new key does not change other segments.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray


def rotation_keys(frames: ArrayLike, quaternions: ArrayLike, bound_rad: float) -> IntArray:
    """Return the frames (K,) to keep as keys so that a rotation stays within a given angle of the recording.

    Args:
        frames: Times (F,), strictly increasing.
        quaternions: Rotations (F, 4) without sign changes (`rotations.continuous`).
        bound_rad: Largest angle between recording and curve, radians.
    """

    def strays(curve: Array, record: Array) -> Array:
        lengths = np.linalg.norm(curve, axis=-1, keepdims=True)
        return np.asarray(rot.angle_between(curve / np.maximum(lengths, 1e-9), record))

    return _keys(frames, quaternions, strays, bound_rad)


def location_keys(frames: ArrayLike, points: ArrayLike, bound: float) -> IntArray:
    """Return the frames (K,) to keep as keys so that points (F, 3) stay within a given distance of the recording."""
    return _keys(frames, points, lambda curve, record: np.linalg.norm(curve - record, axis=-1), bound)


def slopes(frames: ArrayLike, values: ArrayLike) -> Array:
    """Return the slopes (F, C) of recorded values (F, C) at their times (F,)."""
    at, record = np.asarray(frames, dtype=np.float64), np.asarray(values, dtype=np.float64)
    return np.gradient(record, at, axis=0) if len(at) > 1 else np.zeros_like(record)


def _keys(frames: ArrayLike, values: ArrayLike, strays: Callable[[Array, Array], Array], bound: float) -> IntArray:
    at, record = np.asarray(frames, dtype=np.float64), np.asarray(values, dtype=np.float64)
    steep = slopes(at, record)
    kept = {0, len(at) - 1}
    open_stretches = [(0, len(at) - 1)]
    while open_stretches:
        first, last = open_stretches.pop()
        if last - first < 2:
            continue
        within = slice(first + 1, last)
        error = strays(_hermite(at, record, steep, first, last), record[within])
        worst = int(np.argmax(error))
        if error[worst] > bound:
            middle = first + 1 + worst
            kept.add(middle)
            open_stretches += [(first, middle), (middle, last)]
    return np.array(sorted(kept), dtype=np.int64)


def _hermite(at: Array, record: Array, steep: Array, first: int, last: int) -> Array:
    """Return the values (n, C) of the cubic between two keys at the times between them."""
    length = at[last] - at[first]
    s = ((at[first + 1 : last] - at[first]) / length)[:, None]
    ends = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * record[first] + s**2 * (3.0 - 2.0 * s) * record[last]
    return np.asarray(ends + length * (s * (1.0 - s) ** 2 * steep[first] - s**2 * (1.0 - s) * steep[last]))
