"""Measurement of blobs: centre, radius, brightness, hue, contrast, roundness."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from colorsys import rgb_to_hsv
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from ...geometry.arrays import Array, FloatArray, Image, IntArray

X, Y, RADIUS, BRIGHTNESS, HUE, CONTRAST, ROUNDNESS = range(7)
COLUMNS = 7

_GROUP = 1 << 20  # larger than the number of blobs in an image


@dataclass(frozen=True)
class MeasurementSettings:
    """Settings for measuring blobs and splitting markers that touch."""

    # Exponent of the contrast in centroids, chosen for the smallest error on discs of 1.5 to 6 pixels: with 1, missing
    # parts of the rim matter too much; with larger exponents, the position of the peak within a pixel does.
    exponent: float = 1.3
    lit: float = 0.5  # smallest contrast of pixels used for the hue, as a share of the largest
    round_enough: float = 0.6  # ratio of axes above which a blob is a single marker
    split_levels: tuple[float, ...] = (0.45, 0.6, 0.75)  # contrasts that may separate markers, shares of the largest
    # the same for cuts at a neck: distances to the blob's edge, as shares of the largest
    neck_levels: tuple[float, ...] = (0.65, 0.75)
    least_piece: float = 0.15  # smallest part that is a marker of its own, as a share of the largest part
    rim: float = 0.15  # share of the largest contrast below which pixels belong to the surroundings
    skin: float = 0.35  # level that is subtracted, between skin (0) and marker (1)


_MEASUREMENT = MeasurementSettings()


@dataclass(frozen=True)
class BlobPixels:
    """Pixels of several blobs, one blob after another, each from its dimmest pixel to its brightest."""

    owner: IntArray  # (P,) ascending number of each pixel's blob
    x: IntArray  # (P,) in the image
    y: IntArray
    contrast: FloatArray  # (P,) grey levels above the surroundings, positive
    colours: Image  # (P, 3) BGR

    def select(self, which: Any) -> "BlobPixels":
        """Return some of the pixels, in the same order."""
        return BlobPixels(self.owner[which], self.x[which], self.y[which], self.contrast[which], self.colours[which])

    def spans(self) -> tuple[IntArray, IntArray]:
        """Return the index (N,) of each blob's first pixel, and its number (N,) of pixels."""
        others = (self.owner[1:] != self.owner[:-1]).nonzero()[0]
        bounds = np.empty(len(others) + 2, dtype=np.int64)
        bounds[0], bounds[1:-1], bounds[-1] = 0, others + 1, len(self.owner)
        return bounds[:-1], bounds[1:] - bounds[:-1]


def blob_pixels(owner: IntArray, x: IntArray, y: IntArray, contrast: FloatArray, colours: Image) -> BlobPixels:
    """Return the pixels with positive contrast in the order of `BlobPixels`; the owners are ascending."""
    order = np.argsort(owner * 1024.0 + contrast)  # contrasts are smaller than this factor
    order = order[contrast[order] > 0.0]
    return BlobPixels(owner[order], x[order], y[order], contrast[order], colours[order])


NO_PIXELS = blob_pixels(
    *(np.empty(0, dtype=np.int64),) * 3, np.empty(0, dtype=np.float32), np.empty((0, 3), dtype=np.uint8)
)


def join_groups(groups: Sequence[BlobPixels]) -> BlobPixels:
    """Return the blobs of several groups, with numbers from which `group_of` finds the group."""
    if len(groups) == 1:
        return groups[0]
    owners = [group.owner + number * _GROUP for number, group in enumerate(groups)]
    parts = zip(*((group.x, group.y, group.contrast, group.colours) for group in groups), strict=True)
    return BlobPixels(np.concatenate(owners), *(np.concatenate(part) for part in parts))


def group_of(owners: IntArray) -> IntArray:
    """Return the index of the group from which `join_groups` took each blob."""
    return owners // _GROUP


def measure(pixels: BlobPixels) -> tuple[IntArray, Array]:
    """Return the blobs (N,) that have pixels, and their measures (N, 7).

    Columns: x, y, radius (pixels), brightness 0-255, hue 0-180, contrast (grey levels), roundness (ratio of axes).
    """
    if len(pixels.owner) == 0:
        return np.empty(0, dtype=np.int64), np.empty((0, COLUMNS))
    starts, counts = pixels.spans()
    blob = np.repeat(np.arange(len(starts)), counts)
    weights = (pixels.contrast ** np.float32(_MEASUREMENT.exponent)).astype(np.float64)
    left, top = pixels.x[starts], pixels.y[starts]
    x, y = pixels.x - left[blob], pixels.y - top[blob]
    wx, wy = weights * x, weights * y
    moments = np.add.reduceat(np.array((weights, wx, wy, wx * x, wy * y, wx * y)), starts, axis=1)
    x, y, xx, yy, xy = moments[1:] / moments[0]
    spread_x, spread_y, spread_xy = xx - x * x, yy - y * y, xy - x * y
    mean, half = 0.5 * (spread_x + spread_y), np.hypot(0.5 * (spread_x - spread_y), spread_xy)
    # 1/12, the variance of a uniform pixel, keeps the ratio of the smallest blobs near 1
    roundness = np.sqrt((np.maximum(mean - half, 0.0) + 1 / 12) / (mean + half + 1 / 12))
    sums, stops = _sums_before(pixels.contrast), starts + counts
    eighth = np.maximum(counts // 8, 1)
    plateau = (sums[stops] - sums[stops - eighth]) / eighth
    radius = np.sqrt((sums[stops] - sums[starts]) / (math.pi * plateau))
    # without rim pixels, because their number depends on where a small blob lies on the pixel grid
    least = np.array((_MEASUREMENT.lit * plateau, pixels.contrast[stops - eighth]))
    columns = np.ones((len(pixels.x), 4))
    columns[:, :3] = pixels.colours
    totals = np.add.reduceat(columns * (pixels.contrast >= least[:, blob])[..., None], starts, axis=1)
    lit, brightest = totals[..., :3] / totals[..., 3:]
    hues = [180.0 * rgb_to_hsv(*colour[::-1])[0] for colour in lit.tolist()]
    brightness = brightest.max(axis=1)
    rows = np.array((left + x, top + y, radius, brightness, hues, plateau, roundness)).T
    return pixels.owner[starts], rows


def _sums_before(values: FloatArray) -> Array:
    """Return the cumulative sums (P + 1,) of the values, starting with 0."""
    return np.concatenate(([0.0], np.cumsum(values, dtype=np.float64)))


def measure_apart(pixels: BlobPixels) -> tuple[IntArray, Array]:
    """Return the same as `measure`, with touching markers split: a blob may yield several rows."""
    owners, table = measure(pixels)
    found = [(owners, table)]
    whole = table[:, ROUNDNESS] >= _MEASUREMENT.round_enough
    for row in np.flatnonzero(~whole):
        pieces = [measure(piece) for piece in _split(pixels.select(pixels.owner == owners[row]))]
        whole[row] = not pieces
        found += pieces
    if len(found) == 1:
        return owners, table
    found[0] = (owners[whole], table[whole])
    return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])


def subtract_skin(pixels: BlobPixels) -> BlobPixels:
    """Return the spots with the level of the body subtracted.

    If a thin part of the body (a hand) stands out from the background as well, there are two levels, skin and
    marker. Otherwise only the rim is removed.
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
    middle = 0.5 * (values[stop - 1] + values[start])
    below = start
    low = high = 0.0
    for _ in range(8):  # two-means clustering
        split = bisect_left(values, middle, start, stop)
        if split in (start, stop, below):
            break
        below = split
        low = (sums[below] - sums[start]) / (below - start)
        high = (sums[stop] - sums[below]) / (stop - below)
        middle = 0.5 * (low + high)
    if below - start > 1.2 * (stop - below):
        return low + _MEASUREMENT.skin * (high - low)
    return _MEASUREMENT.rim * values[stop - 1]


def _split(pixels: BlobPixels) -> list[BlobPixels]:
    """Return the pixels of each of several touching markers; an empty list for a single marker.

    A higher threshold separates the markers or, if flat discs overlap without a valley between them, a cut at the neck.
    """
    x, y = pixels.x - pixels.x.min() + 1, pixels.y - pixels.y.min() + 1
    contrast = np.zeros((y.max() + 2, x.max() + 2), dtype=np.float32)
    contrast[y, x] = pixels.contrast
    peak = float(contrast.max())
    inside = cv2.distanceTransform((contrast >= 0.5 * peak).astype(np.uint8), cv2.DIST_L2, 5)
    levels = [contrast >= level * peak for level in _MEASUREMENT.split_levels]
    levels += [inside >= level * inside.max() for level in _MEASUREMENT.neck_levels]
    for mask in levels:
        count, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
        sizes = np.bincount(parts.ravel(), minlength=count)[1:]
        large = [i + 1 for i, size in enumerate(sizes) if size >= max(3, _MEASUREMENT.least_piece * sizes.max())]
        if len(large) >= 2:
            outside = [(parts != i).astype(np.uint8) for i in large]
            distances = np.stack([cv2.distanceTransform(mask, cv2.DIST_L2, 3) for mask in outside])
            nearest = distances.argmin(axis=0)[y, x]
            return [pixels.select(nearest == i) for i in range(len(large))]
    return []
