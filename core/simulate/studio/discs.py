"""Bright discs drawn through a slightly blurred lens, with exact centres.

A sharp disc a few pixels wide, sampled by square pixels, has a centroid that is off by up to 0.02 pixels; no real lens
is that sharp. The disc's coverage is therefore computed exactly on a finer grid, then blurred and summed into pixels.
"""

import math
from functools import lru_cache

import numpy as np

from ...geometry.arrays import Array, Image

_LINES = 16  # lines per pixel in y
_CELLS = 4  # cells per pixel in x, covered exactly
_error_function = np.vectorize(math.erf, otypes=[float])


def disc_light(centres: Array, radius: float, blur_px: float) -> tuple[int, int, Array]:
    """Return the first column and row of a disc's pixels, and the share (height, width) of each pixel that is covered.

    Args:
        centres: Disc centres (S, 2) at S times of the exposure, over which the coverage is averaged; pixels, with
            pixel centres at whole numbers.
        radius: Radius in pixels.
        blur_px: Standard deviation of the lens's blur.
    """
    low = np.floor(centres.min(axis=0) - radius + 0.5).astype(int)
    columns, rows = (np.floor(centres.max(axis=0) + radius + 0.5).astype(int) - low + 1).tolist()
    lines = low[1] - 0.5 + (np.arange(rows * _LINES) + 0.5) / _LINES
    half = np.sqrt(np.maximum(radius * radius - (lines - centres[:, 1:2]) ** 2, 0.0))
    edges = low[0] - 0.5 + np.arange(columns * _CELLS + 1) / _CELLS
    x = centres[:, :1]
    filled = np.minimum(np.maximum(edges, (x - half)[..., None]), (x + half)[..., None])
    # cell edges clipped to the disc's chord on each line: their differences are the covered lengths of the cells
    length = filled[..., 1:] - filled[..., :-1]
    inside = (length[0] if len(length) == 1 else length.sum(axis=0) / len(length)) * _CELLS
    light: Array = _gather(rows, _LINES, blur_px) @ inside @ _gather(columns, _CELLS, blur_px).T
    margin = _margin(blur_px)
    return int(low[0]) - margin, int(low[1]) - margin, light


def _margin(blur_px: float) -> int:
    return int(np.ceil(3.0 * blur_px))


@lru_cache(maxsize=256)
def _gather(pixels: int, cells: int, blur_px: float) -> Array:
    """Return weights (P, C) that blur the light of C cells and sum it into P pixels, margins included."""
    margin = _margin(blur_px)
    place = -0.5 + (np.arange(pixels * cells) + 0.5) / cells
    offset = place - np.arange(-margin, pixels + margin)[:, None]
    if blur_px == 0.0:
        return np.where(np.abs(offset) < 0.5, 1.0, 0.0) / cells
    upper, lower = (_error_function((offset + half) / (math.sqrt(2.0) * blur_px)) for half in (0.5, -0.5))
    return np.asarray(0.5 * (upper - lower) / cells)


def draw_disc(image: Image, centres: Array, radius: float, colour: Array, blur_px: float = 0.0) -> None:
    """Blend a disc of a BGR colour into an image, in place; see `disc_light` for the arguments."""
    rows, columns = image.shape[:2]
    left, top, light = disc_light(centres, radius, blur_px)
    right, bottom = left + light.shape[1], top + light.shape[0]
    if right <= 0 or bottom <= 0 or left >= columns or top >= rows:
        return
    share = light[max(-top, 0) : rows - top, max(-left, 0) : columns - left, None]
    patch = image[max(top, 0) : bottom, max(left, 0) : right]
    patch[:] = (patch + share * (colour - patch) + 0.5).astype(np.uint8)
