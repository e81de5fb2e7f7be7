"""Blender's default curves for new keys: Bezier, Auto Clamped handles, Continuous Acceleration.

All handles reach a third of the way to the next key, so time runs evenly and the curve is a cubic spline with a slope
at each key. Slopes are zero at both ends and at extremes. Between these they make the acceleration continuous, except
that no handle may point backwards or beyond the value of the next key.
"""

import numpy as np

from ..geometry.arrays import Array
from ..geometry.cubic_curves import hermite


def key_slopes(times: Array, values: Array) -> Array:
    """Return the slopes of Blender's default curves at their keys.

    Args:
        times: Times (K,) of the keys, strictly ascending.
        values: Values (K, C) of all channels.

    Returns:
        Changes (K, C) of the values per unit of time.
    """
    if len(times) < 3:
        return np.zeros(values.shape)
    spans = np.diff(times)[:, None]
    secants = np.diff(values, axis=0) / spans
    # at three times the secant's slope a handle reaches the value of the next key; at an extreme handles are flat
    limits = np.sign(secants[1:]) * 3.0 * np.minimum(abs(secants[:-1]), abs(secants[1:]))
    limits[secants[:-1] * secants[1:] <= 0.0] = 0.0
    lowest, highest = np.minimum(limits, 0.0), np.maximum(limits, 0.0)
    before, after = 1.0 / spans[:-1], 1.0 / spans[1:]
    bends = 3.0 * (secants[:-1] * before + secants[1:] * after)
    slopes = np.zeros(values.shape)
    for _ in range(50):  # each sweep at least halves the error, because a key weighs twice as much as its neighbours
        smooth = (bends - before * slopes[:-2] - after * slopes[2:]) / (2.0 * (before + after))
        slopes[1:-1] = np.minimum(np.maximum(smooth, lowest), highest)
    return slopes


def curve_positions(times: Array, positions_m: Array, at: Array) -> Array:
    """Return positions (F, C) on Blender's default curves, constant before and after the keys.

    Args:
        times: Times (K,) of the keys, strictly ascending, at least one.
        positions_m: Values (K, C) at the keys.
        at: Times (F,) in the same unit.
    """
    if len(times) == 1:
        return np.repeat(positions_m, len(at), axis=0)
    return hermite(times, positions_m, key_slopes(times, positions_m), np.clip(at, times[0], times[-1]))
