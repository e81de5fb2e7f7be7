"""NumPy array types, runs of set flags, means over known values, and arrays as text."""

import base64

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float32]  # 32 bit, where memory or time matters
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]  # (height, width) grey, or (height, width, 3)


def runs(flags: Mask) -> list[tuple[int, int]]:
    """Return (start, stop) of each unbroken run of set flags in a mask (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def evenly(total: int, most: int) -> IntArray:
    """Return at most `most` indices spread evenly from 0 to total - 1."""
    return np.unique(np.linspace(0, total - 1, min(most, total)).astype(np.int64)) if total else np.arange(0)


def median_of_known(values: Array) -> Array:
    """Return the medians over frames of the known values in (F, ...), NaN where no value is known."""
    known = np.isfinite(values).any(axis=0)
    found = np.full(known.shape, np.nan)
    found[known] = np.nanmedian(values[:, known], axis=0)
    return found


def mean_of_known(values: Array) -> Array:
    """Return the means over frames of the known values in (F, ...), NaN where no value is known."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    return np.where(count > 0, np.sum(values, axis=0, where=known) / np.maximum(count, 1), np.nan)


def packed(values: Array) -> str:
    """Return numbers as text: base 64 of 32-bit floats."""
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")


def unpacked(text: str) -> Array:
    """Return the numbers (N,) from the text of `packed`."""
    return np.frombuffer(base64.b64decode(text), "<f4").astype(np.float64)
