"""Blobs measured in images: sharpness, streaks, speed."""

from dataclasses import dataclass

import cv2
import numpy as np

from ...geometry.arrays import Array, FloatArray, Image, IntArray
from ...vision.matching.image_tracks import BlobLinker

_FEWEST_SPOTS = 3  # fewest blobs in an image that shows markers
_LEAST_PEAK = 20.0  # smallest contrast to the surroundings with a measurable edge, grey levels


@dataclass(frozen=True)
class Spots:
    """Blobs in the images of one camera, with their shape and velocity.

    Args:
        images: Index (N,) of each blob's image.
        pixels: Centres (N, 2).
        brightness: Grey levels (N,) of the brightest channel.
        radius_px: Radii (N,).
        edge_px: Widths (N,) of edges, contrast divided by the steepest slope: about 2 for a sharp blob; NaN if not
            measurable.
        spread_px2: Second moments (N, 2, 2) of the light about the centre.
        velocity_px_s: Velocities (N, 2), NaN where the blob is missing in the image before or after.
    """

    images: IntArray
    pixels: Array
    brightness: Array
    radius_px: Array
    edge_px: Array
    spread_px2: Array
    velocity_px_s: Array

    @property
    def speed_px_s(self) -> Array:
        """Speeds (N,)."""
        return np.asarray(np.linalg.norm(self.velocity_px_s, axis=1))


class SpotRecorder:
    """Measures the blobs of one camera, image by image.

    Args:
        level: Grey levels (height, width) of the background's brightest channel.
    """

    def __init__(self, level: FloatArray) -> None:
        self._linker = BlobLinker(level.shape[1])
        self._level = level
        self._times_s: list[float] = []
        self._blobs: list[FloatArray] = []
        self._tracks: list[IntArray] = []
        self._shapes: list[tuple[float, Array]] = []
        self.images = 0
        # contrast of the brightest pixels to the background, grey levels, in each image with hardly any blobs
        self.rises: list[float] = []

    def add(self, time_s: float, image: Image, blobs: FloatArray) -> None:
        """Add the next image and its blobs (n, 5) from `Detector.detect`."""
        if len(blobs) < _FEWEST_SPOTS:
            rise = (image.max(axis=2) - self._level).ravel()
            self.rises.append(float(np.partition(rise, -6)[-6]))  # brighter pixels may be sensor defects
        self.images += 1
        self._times_s.append(time_s)
        self._blobs.append(blobs)
        self._tracks.append(self._linker.link(time_s, blobs[:, :2].astype(np.float64)))
        self._shapes += [_shape(image, row) for row in blobs]

    def result(self) -> Spots:
        """Return the blobs of all images."""
        table = np.concatenate([np.empty((0, 5)), *self._blobs]).astype(np.float64)
        tracks = np.concatenate([np.empty(0, dtype=np.int64), *self._tracks])
        images = np.repeat(np.arange(len(self._blobs)), [len(rows) for rows in self._blobs])
        edges = np.array([edge for edge, _ in self._shapes])
        spreads = np.array([spread for _, spread in self._shapes]).reshape(-1, 2, 2)
        velocity = _velocities(tracks, images, table[:, :2], np.array(self._times_s))
        return Spots(images, table[:, :2], table[:, 3], table[:, 2], edges, spreads, velocity)


def _shape(image: Image, row: FloatArray) -> tuple[float, Array]:
    """Return the edge width and the second moments (2, 2) of a blob, NaN if they cannot be measured."""
    unknown = float("nan"), np.full((2, 2), np.nan)
    x, y = round(float(row[0])), round(float(row[1]))
    reach = round(2.0 * float(row[2])) + 7
    left, top = max(x - reach, 0), max(y - reach, 0)
    blue, green, red = np.moveaxis(image[top : y + reach + 1, left : x + reach + 1], 2, 0)
    # several times as fast as max(axis=2) and median
    patch = np.maximum(np.maximum(blue, green), red).astype(np.float32)
    levels = np.sort(patch, axis=None)
    light = patch - np.float32(0.5) * (levels[(len(levels) - 1) // 2] + levels[len(levels) // 2])
    column, line = x - left, y - top
    if not (0 <= line < light.shape[0] and 0 <= column < light.shape[1]):
        return unknown
    peak = float(light[max(line - 1, 0) : line + 2, max(column - 1, 0) : column + 2].max())
    if peak < _LEAST_PEAK:
        return unknown
    _, parts = cv2.connectedComponents((light > 0.2 * peak).astype(np.uint8))
    inside = parts == parts[line, column]
    if parts[line, column] == 0:
        return unknown
    slope = np.hypot(cv2.Sobel(light, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(light, cv2.CV_32F, 0, 1, scale=0.125))
    rows, columns = np.nonzero(inside)
    weights = light[inside] / light[inside].sum()
    offsets = np.stack((columns - weights @ columns, rows - weights @ rows), axis=1)
    return peak / float(slope[inside].max()), (weights[:, None] * offsets).T @ offsets


def _velocities(ids: IntArray, numbers: IntArray, pixels: Array, times_s: Array) -> Array:
    """Return velocities (N, 2) from the previous to the next image, NaN if the blob is missing in either."""
    place = {
        (track, number): row for row, (track, number) in enumerate(zip(ids.tolist(), numbers.tolist(), strict=True))
    }
    velocity = np.full((len(ids), 2), np.nan)
    for (track, number), row in place.items():
        before, after = place.get((track, number - 1)), place.get((track, number + 1))
        if before is not None and after is not None:
            velocity[row] = (pixels[after] - pixels[before]) / (times_s[number + 1] - times_s[number - 1])
    return velocity
