"""Filters along the frames of a motion: Gaussian mean, largest, smallest and usual value of a window around each frame.

At the ends, the first and the last value are repeated.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, Mask


def gaussian(values: Array, sigma: float, border: str = "edge") -> Array:
    """Return values (F, ...) smoothed along the frames.

    Args:
        sigma: Standard deviation in frames, above 0; weights beyond four times this are left out.
        border: How `numpy.pad` continues the values beyond their ends.
    """
    radius = int(4.0 * sigma + 0.5)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    columns = _padded(values, radius, border).reshape(len(values) + 2 * radius, -1).T
    smooth = [np.convolve(column, weights / weights.sum(), mode="valid") for column in columns]
    return np.stack(smooth, axis=1).reshape(values.shape)


def largest(values: NDArray[Any], radius: int) -> NDArray[Any]:
    """Return the largest of the values (F, ...) up to `radius` frames before and after each frame."""
    return _extreme(np.maximum, values, radius)


def smallest(values: NDArray[Any], radius: int) -> NDArray[Any]:
    """Return the smallest of the values (F, ...) up to `radius` frames before and after each frame."""
    return _extreme(np.minimum, values, radius)


def usual(flags: Mask, radius: int) -> Mask:
    """Return the flag (F, ...) that most of the frames up to `radius` before and after each frame have."""
    padded = _padded(flags, radius + 1).astype(np.int64)
    count = np.cumsum(padded, axis=0)
    return np.asarray(count[2 * radius + 1 : -1] - count[: -2 * radius - 2] > radius)


def frames_to(flags: Mask) -> Array:
    """Return the distances (F,) from each frame to the nearest one whose flag is set, frames; at least one is."""
    at, frames = np.flatnonzero(flags), np.arange(len(flags))
    after = np.searchsorted(at, frames)
    before, after = at[np.maximum(after - 1, 0)], at[np.minimum(after, len(at) - 1)]
    return np.minimum(np.abs(frames - before), np.abs(frames - after)).astype(np.float64)


def _extreme(pick: np.ufunc, values: NDArray[Any], radius: int) -> NDArray[Any]:
    row, span = _padded(values, radius), 1
    while 2 * span <= 2 * radius + 1:  # each entry is the extreme of the next `span` ones
        row, span = pick(row[:-span], row[span:]), 2 * span
    return np.asarray(pick(row[: len(values)], row[len(row) - len(values) :]))


def _padded(values: NDArray[Any], radius: int, border: str = "edge") -> NDArray[Any]:
    width = [(radius, radius), *[(0, 0)] * (values.ndim - 1)]
    return np.pad(values, width, mode=border)  # type: ignore[call-overload]
