"""Blender's default curves: Bezier, auto-clamped handles, smooth.

As Blender draws them for new keys (handle type Auto Clamped, smoothing Continuous Acceleration): all handles reach a
third of the way to the next key, so time runs evenly and a curve is a cubic spline with a slope at each key. Slopes
are flat at both ends and at extremes; between these they make the acceleration continuous, but no handle may point
backwards or past the value of the next key.
"""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..geometry.arrays import Array

_SWEEPS = 50  # each at least halves the error, because a key weighs twice its neighbours


def key_slopes(times: Array, values: Array) -> Array:
    """Return the slopes of Blender's default curve at its keys.

    Args:
        times: (K,) ascending, no two the same.
        values: (K,) of one channel.

    Returns:
        (K,) change of the value per unit of time.
    """
    if len(times) < 3:
        return np.zeros(len(times))
    spans = np.diff(times)
    secants = np.diff(values) / spans
    # a handle of a third of the span reaches the next value at three times the secant; at an extreme it is flat
    limits = np.sign(secants[1:]) * 3.0 * np.minimum(abs(secants[:-1]), abs(secants[1:]))
    limits[secants[:-1] * secants[1:] <= 0.0] = 0.0
    lowest, highest = np.minimum(limits, 0.0), np.maximum(limits, 0.0)
    before, after = 1.0 / spans[:-1], 1.0 / spans[1:]
    bends = 3.0 * (secants[:-1] * before + secants[1:] * after)
    slopes = np.zeros(len(times))
    for _ in range(_SWEEPS):
        smooth = (bends - before * slopes[:-2] - after * slopes[2:]) / (2.0 * (before + after))
        slopes[1:-1] = np.clip(smooth, lowest, highest)
    return slopes


def curve_positions(times: Array, positions_m: Array, at: Array) -> Array:
    """Return positions on Blender's default curves, held before and after the keys.

    Args:
        times: (K,) ascending, no two the same, at least one.
        positions_m: (K, C) of the keys.
        at: (F,) times in the same unit.

    Returns:
        (F, C) in metres.
    """
    if len(times) == 1:
        return np.repeat(positions_m, len(at), axis=0)
    slopes = np.stack([key_slopes(times, channel) for channel in positions_m.T], axis=1)
    curve = CubicHermiteSpline(times, positions_m, slopes, axis=0)
    return np.asarray(curve(np.clip(at, times[0], times[-1])))
