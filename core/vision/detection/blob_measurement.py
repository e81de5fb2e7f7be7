"""Measurement of blobs: centre, radius, brightness, hue, contrast, roundness."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from colorsys import rgb_to_hsv
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from ...geometry.arrays import Array, FloatArray, Image, IntArray, Mask

X, Y, RADIUS, BRIGHTNESS, HUE, CONTRAST, ROUNDNESS = range(7)
COLUMNS = 7

_ROUND_ENOUGH = 0.6
_SPLIT_LEVELS = (0.45, 0.6, 0.75)
_NECK_LEVELS = (0.65, 0.75)
_RIM_SHARE = 0.15
_LIT = 0.5  # contrast of pixels that tell the hue, as a share of the blob's most
_ABOVE_ALL = 1024.0  # grey levels
_GROUP = 1 << 20  # more than an image has blobs


@dataclass(frozen=True)
class BlobPixels:
    """Pixels of some blobs, blob after blob, each from its dimmest to its brightest.

    Args:
        owner: (P,) number of the blob that each belongs to, ascending.
        x, y: (P,) where they are in the image.
        contrast: (P,) grey levels above the surroundings, positive.
        colours: (P, 3) BGR.
    """

    owner: IntArray
    x: IntArray
    y: IntArray
    contrast: FloatArray
    colours: Image

    def select(self, which: Any) -> "BlobPixels":
        """Return some of the pixels, in their order."""
        return BlobPixels(self.owner[which], self.x[which], self.y[which], self.contrast[which], self.colours[which])

    def spans(self) -> tuple[IntArray, IntArray]:
        """Return where each of the N blobs begins and how many pixels it has."""
        others = (self.owner[1:] != self.owner[:-1]).nonzero()[0]
        bounds = np.empty(len(others) + 2, dtype=np.int64)
        bounds[0], bounds[1:-1], bounds[-1] = 0, others + 1, len(self.owner)
        return bounds[:-1], bounds[1:] - bounds[:-1]


def blob_pixels(owner: IntArray, x: IntArray, y: IntArray, contrast: FloatArray, colours: Image) -> BlobPixels:
    """Return the pixels with any contrast, in order; the owners are ascending."""
    order = np.argsort(owner * _ABOVE_ALL + contrast)
    order = order[contrast[order] > 0.0]
    return BlobPixels(owner[order], x[order], y[order], contrast[order], colours[order])


NO_PIXELS = blob_pixels(
    *(np.empty(0, dtype=np.int64),) * 3, np.empty(0, dtype=np.float32), np.empty((0, 3), dtype=np.uint8)
)


def join_groups(groups: Sequence[BlobPixels]) -> BlobPixels:
    """Return the blobs of some groups, each with its group in its number."""
    if len(groups) == 1:
        return groups[0]
    return BlobPixels(
        np.concatenate([group.owner + number * _GROUP for number, group in enumerate(groups)]),
        np.concatenate([group.x for group in groups]),
        np.concatenate([group.y for group in groups]),
        np.concatenate([group.contrast for group in groups]),
        np.concatenate([group.colours for group in groups]),
    )


def group_of(owners: IntArray) -> IntArray:
    """Return the joined group of each blob."""
    return owners // _GROUP


def measure(pixels: BlobPixels) -> tuple[IntArray, Array]:
    """Return the blobs (N,) with pixels, and their measures (N, 7).

    Columns: x, y, radius (pixels), brightness 0-255, hue 0-180, contrast (grey levels), roundness (ratio of axes).
    """
    if len(pixels.owner) == 0:
        return np.empty(0, dtype=np.int64), np.empty((0, COLUMNS))
    starts, counts = pixels.spans()
    blob = np.repeat(np.arange(len(starts)), counts)
    # the plain centroid suffers from what the rim lacks, higher powers from how the peak falls on the pixels: of discs
    # of 1.5 to 6 pixels 1.3 has the least error
    weights = (pixels.contrast ** np.float32(1.3)).astype(np.float64)
    left, top = pixels.x[starts], pixels.y[starts]
    x, y = pixels.x - left[blob], pixels.y - top[blob]
    wx, wy = weights * x, weights * y
    moments = np.add.reduceat(np.array((weights, wx, wy, wx * x, wy * y, wx * y)), starts, axis=1)
    x, y, xx, yy, xy = moments[1:] / moments[0]
    spread_x, spread_y, spread_xy = xx - x * x, yy - y * y, xy - x * y
    mean, half = 0.5 * (spread_x + spread_y), np.hypot(0.5 * (spread_x - spread_y), spread_xy)
    # a pixel's own extent (1/12) keeps the ratio of the smallest blobs in bounds
    roundness = np.sqrt((np.maximum(mean - half, 0.0) + 1 / 12) / (mean + half + 1 / 12))
    sums, stops = _sums_before(pixels.contrast), starts + counts
    eighth = np.maximum(counts // 8, 1)
    plateau = (sums[stops] - sums[stops - eighth]) / eighth
    radius = np.sqrt((sums[stops] - sums[starts]) / (math.pi * plateau))
    # rim pixels would make it dimmer: of a small blob many or few are half bright, by how it falls on the pixels
    least = np.array((_LIT * plateau, pixels.contrast[stops - eighth]))
    lit, brightest = _mean_colours(pixels, least[:, blob], starts)
    hues = [180.0 * rgb_to_hsv(*colour[::-1])[0] for colour in lit.tolist()]
    brightness = brightest.max(axis=1)
    rows = np.array((left + x, top + y, radius, brightness, hues, plateau, roundness)).T
    return pixels.owner[starts], rows


def _mean_colours(pixels: BlobPixels, least: Array, starts: IntArray) -> Array:
    """Return mean colours (K, N, 3) where contrast is at least so much (K, P)."""
    columns = np.ones((len(pixels.x), 4))
    columns[:, :3] = pixels.colours
    sums = np.add.reduceat(columns * (pixels.contrast >= least)[..., None], starts, axis=1)
    return np.asarray(sums[..., :3] / sums[..., 3:])


def _sums_before(values: FloatArray) -> Array:
    """Return (P + 1,) the sum of all values before each, and of all."""
    return np.concatenate(([0.0], np.cumsum(values, dtype=np.float64)))


def measure_apart(pixels: BlobPixels) -> tuple[IntArray, Array]:
    """Return `measure` with touching markers split: a blob may have several rows."""
    owners, table = measure(pixels)
    found = [(owners, table)]
    whole = table[:, ROUNDNESS] >= _ROUND_ENOUGH
    for row in np.flatnonzero(~whole):
        pieces = [measure(piece) for piece in _split(pixels.select(pixels.owner == owners[row]))]
        whole[row] = not pieces
        found += pieces
    if len(found) == 1:
        return owners, table
    found[0] = (owners[whole], table[whole])
    return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])


def subtract_skin(pixels: BlobPixels) -> BlobPixels:
    """Return the spots that rise above the body.

    Where a thin part of the body (a hand) stands out from the background as well, two levels are found, skin and
    marker; what lies below the middle of the two is skin. Else only the lowest part, the rim, is taken off.
    """
    if len(pixels.owner) == 0:
        return pixels
    starts, counts = pixels.spans()
    values, sums = pixels.contrast.tolist(), _sums_before(pixels.contrast).tolist()
    spans = zip(starts.tolist(), (starts + counts).tolist(), strict=True)
    levels = np.array([_skin_level(values, sums, start, stop) for start, stop in spans], dtype=np.float32)
    contrast = pixels.contrast - np.repeat(levels, counts)
    return replace(pixels, contrast=contrast).select(contrast > 0.0)


def _skin_level(values: list[float], sums: list[float], start: int, stop: int) -> float:
    """Return the skin level of the ascending values from `start` to `stop`."""
    level = _RIM_SHARE * values[stop - 1]
    middle = 0.5 * (values[stop - 1] + values[start])
    below = start
    low = high = 0.0
    for _ in range(8):  # two means, of the values below and above their middle
        split = bisect_left(values, middle, start, stop)
        if split in (start, stop, below):
            break
        below = split
        low = (sums[below] - sums[start]) / (below - start)
        high = (sums[stop] - sums[below]) / (stop - below)
        middle = 0.5 * (low + high)
    return low + 0.35 * (high - low) if below - start > 1.2 * (stop - below) else level


def _split(pixels: BlobPixels) -> list[BlobPixels]:
    """Take apart markers that touch. Empty when there is one only.

    At some higher level of brightness they are separate; flat discs, which overlap without a valley, are where
    the blob is narrower between them than across each.
    """
    x, y = pixels.x - pixels.x.min() + 1, pixels.y - pixels.y.min() + 1  # a margin: distances are to the outside
    contrast = np.zeros((y.max() + 2, x.max() + 2), dtype=np.float32)
    contrast[y, x] = pixels.contrast
    peak = float(contrast.max())
    inside = cv2.distanceTransform((contrast >= 0.5 * peak).astype(np.uint8), cv2.DIST_L2, 5)
    levels = [contrast >= level * peak for level in _SPLIT_LEVELS]
    levels += [inside >= level * inside.max() for level in _NECK_LEVELS]
    for mask in levels:
        count, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
        sizes = np.bincount(parts.ravel(), minlength=count)[1:]
        large = [i + 1 for i, size in enumerate(sizes) if size >= max(3, 0.15 * sizes.max())]
        if len(large) >= 2:
            distances = np.stack([_distance_to(parts == i) for i in large])
            nearest = distances.argmin(axis=0)[y, x]
            return [pixels.select(nearest == i) for i in range(len(large))]
    return []


def _distance_to(mask: Mask) -> FloatArray:
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3), dtype=np.float32)
