"""Bright discs with exact area coverage, so that their centres stand where they are said to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LINES_PER_PIXEL = 8


def coverage(centres: Array, radius: float, left: int, top: int, width: int, height: int) -> Array:
    """Share of each pixel (height, width) that a disc covers, averaged over S positions of its centre.

    centres: (S, 2) pixels (x, y), pixel centres at whole numbers; radius in pixels. The part covered is exact
    along x (chord lengths) and summed over lines in y.
    """
    lines = top - 0.5 + (np.arange(height * _LINES_PER_PIXEL) + 0.5) / _LINES_PER_PIXEL
    half = np.sqrt(np.maximum(radius * radius - (lines - centres[:, 1:2]) ** 2, 0.0))
    edges = left - 0.5 + np.arange(width + 1)
    x = centres[:, :1]
    low, high = (x - half)[..., None], (x + half)[..., None]
    filled = np.clip(edges, low, high)
    # length of the chord left of each edge; neighbours' difference is what lies inside a pixel
    inside = np.diff(filled, axis=-1).mean(axis=0)
    shares: Array = inside.reshape(height, _LINES_PER_PIXEL, width).mean(axis=1)
    return shares


def draw_disc(image: NDArray[np.uint8], centres: Array, radius: float, colour: Array, strength: float = 1.0) -> None:
    """Blend a disc of a BGR colour into an image, in place.

    centres: (S, 2) positions during the exposure (one, if it does not move); strength 0..1 is its opacity.
    What lies outside the image is cut off.
    """
    rows, columns = image.shape[:2]
    low = np.floor(centres.min(axis=0) - radius - 0.5)
    high = np.ceil(centres.max(axis=0) + radius + 0.5)
    left, top = max(int(low[0]), 0), max(int(low[1]), 0)
    right, bottom = min(int(high[0]) + 1, columns), min(int(high[1]) + 1, rows)
    if left >= right or top >= bottom:
        return
    share = strength * coverage(centres, radius, left, top, right - left, bottom - top)[..., None]
    patch = image[top:bottom, left:right]
    patch[:] = np.rint(patch * (1.0 - share) + share * colour).astype(np.uint8)
