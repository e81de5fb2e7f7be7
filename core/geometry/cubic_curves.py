"""Cubic curves through values at knots."""

import numpy as np

from .arrays import Array


def hermite(knots: Array, values: Array, slopes: Array, places: Array) -> Array:
    """Return values (N, ...) of the cubic Hermite spline at places (N,).

    Args:
        knots: Knots (K,), strictly ascending, at least two; beyond them, the first or the last cubic goes on.
        values: Values (K, ...) at the knots.
        slopes: Derivatives (K, ...) at the knots.
    """
    before = np.clip(np.searchsorted(knots, places, side="right") - 1, 0, len(knots) - 2)
    each = len(before), *[1] * (values.ndim - 1)
    step = (knots[before + 1] - knots[before]).reshape(each)
    share = (places - knots[before]).reshape(each) / step
    start, rise = values[before], values[before + 1] - values[before]
    first, last = step * slopes[before], step * slopes[before + 1]
    bend = 3.0 * rise - 2.0 * first - last + share * (first + last - 2.0 * rise)
    return np.asarray(start + share * (first + share * bend))


def cubic_spline(knots: Array, values: Array, places: Array) -> Array:
    """Return values (N, ...) at places (N,) of the cubic spline through values (K, ...) at knots (K,), K >= 4.

    Its second derivative is continuous, and its third at the second and the last but one knot, too ("not a knot"; de
    Boor, A Practical Guide to Splines, chapter IV).
    """
    flat = values.reshape(len(knots), -1)
    step = np.diff(knots)
    secants = np.diff(flat, axis=0) / step[:, None]
    inner = np.arange(1, len(knots) - 1)
    system, right = np.zeros((len(knots), len(knots))), np.empty_like(flat)
    system[inner, inner - 1], system[inner, inner + 1] = step[1:], step[:-1]
    system[inner, inner] = 2.0 * (step[:-1] + step[1:])
    right[1:-1] = 3.0 * (step[1:, None] * secants[:-1] + step[:-1, None] * secants[1:])
    for end, inward in ((0, 1), (-1, -2)):
        both = step[end] + step[inward]
        system[end, [end, inward]] = step[inward], both
        right[end] = ((step[end] + 2.0 * both) * step[inward] * secants[end] + step[end] ** 2 * secants[inward]) / both
    slopes = np.linalg.solve(system, right).reshape(values.shape)
    return hermite(knots, values, slopes, places)
