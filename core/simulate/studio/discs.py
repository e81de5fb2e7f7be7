"""Bright discs drawn through a lens with a little blur, so that their centres stand where they are said to be.

A sharp disc a few pixels wide, sampled by square pixels, has a centroid that is off by up to 0.02 pixels; a real
lens never is that sharp. The disc is therefore covered exactly on a finer grid, then blurred and summed into pixels.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

Array = NDArray[np.float64]

_LINES = 16  # lines to a pixel in y
_CELLS = 4  # cells to a pixel in x, covered exactly


def coverage(centres: Array, radius: float, blur_px: float, left: int, top: int, width: int, height: int) -> Array:
    """Light (height, width), 0..1, of a disc in the pixels from (left, top), averaged over S places of its centre.

    centres: (S, 2) pixels (x, y), pixel centres at whole numbers; radius and blur_px (sigma of the lens) in pixels.
    """
    margin = _margin(blur_px)
    columns, rows = width + 2 * margin, height + 2 * margin
    lines = top - margin - 0.5 + (np.arange(rows * _LINES) + 0.5) / _LINES
    half = np.sqrt(np.maximum(radius * radius - (lines - centres[:, 1:2]) ** 2, 0.0))
    edges = left - margin - 0.5 + np.arange(columns * _CELLS + 1) / _CELLS
    x = centres[:, :1]
    filled = np.clip(edges, (x - half)[..., None], (x + half)[..., None])
    # length of the chord left of each edge; the difference between edges is what lies in a cell
    length = filled[..., 1:] - filled[..., :-1]
    inside = (length[0] if len(length) == 1 else length.sum(axis=0) / len(length)) * _CELLS
    light: Array = _gather(height, _LINES, blur_px) @ inside @ _gather(width, _CELLS, blur_px).T
    return light


def _margin(blur_px: float) -> int:
    return int(np.ceil(3.0 * blur_px))


@lru_cache(maxsize=256)
def _gather(pixels: int, cells: int, blur_px: float) -> Array:
    """Weights (pixels, cells of all pixels and margins): share of a cell's light that the lens sends to each pixel."""
    margin = _margin(blur_px)
    place = -margin - 0.5 + (np.arange((pixels + 2 * margin) * cells) + 0.5) / cells
    offset = place - np.arange(pixels)[:, None]
    if blur_px == 0.0:
        return np.where(np.abs(offset) < 0.5, 1.0, 0.0) / cells
    weights: Array = (ndtr((offset + 0.5) / blur_px) - ndtr((offset - 0.5) / blur_px)) / cells
    return weights


def draw_disc(image: NDArray[np.uint8], centres: Array, radius: float, colour: Array, blur_px: float = 0.0) -> None:
    """Blend a disc of a BGR colour into an image, in place.

    centres: (S, 2) positions during the exposure (one, if it does not move). What lies outside the image is cut off.
    """
    rows, columns = image.shape[:2]
    reach = radius + 3.0 * blur_px + 0.5
    low, high = np.floor(centres.min(axis=0) - reach), np.ceil(centres.max(axis=0) + reach)
    left, top = max(int(low[0]), 0), max(int(low[1]), 0)
    right, bottom = min(int(high[0]) + 1, columns), min(int(high[1]) + 1, rows)
    if left >= right or top >= bottom:
        return
    share = coverage(centres, radius, blur_px, left, top, right - left, bottom - top)[..., None]
    patch = image[top:bottom, left:right]
    patch[:] = np.rint(patch + share * (colour - patch)).astype(np.uint8)
