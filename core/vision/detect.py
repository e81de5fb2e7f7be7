"""Markers in one image: blobs in the foreground with sub-pixel centres."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import CaptureError, SettingsError
from .background import Background

Image = NDArray[np.uint8]
Float32 = NDArray[np.float32]

_SPLIT_LEVELS = (0.45, 0.6, 0.75)
_NECK_LEVELS = (0.65, 0.75)
_ROUND_ENOUGH = 0.6
_MEMORY = 0.9  # per frame, of the automatic threshold
_USUAL_MARKERS = 8
_SPOT_KERNEL = np.ones((11, 11), np.uint8)  # wider than a marker on a performer who is seen whole at 640x480
_LOWEST_SPOT_CONTRAST = 40.0  # against the body, which is lit and creased
_SPOT_BRIGHTNESS = 0.85  # of the usual spot's: reflectors are brighter than skin and cloth
_RIM_SHARE = 0.15


@dataclass(frozen=True)
class DetectionSettings:
    """How markers are found.

    Args:
        threshold: grey levels by which a pixel must differ from the background; None: found automatically.
        sigmas: the same in standard deviations of the pixel; the larger of the two counts.
        dilation_px: growth of the foreground, so that the soft rim of a marker belongs to it.
        minimum_radius_px, maximum_radius_px: size of a marker in the image.
        minimum_roundness: smallest ratio of a blob's short to its long axis (motion blur makes discs long).
        relative_brightness: a blob dimmer than this share of the usual marker is no marker (automatic threshold).
        relative_radius: the same for its radius: small glints of clothing are no markers.
        maximum_blobs: at most so many, brightest first.
    """

    threshold: float | None = None
    sigmas: float = 6.0
    dilation_px: int = 1
    minimum_radius_px: float = 0.8
    maximum_radius_px: float = 12.0
    minimum_roundness: float = 0.3
    relative_brightness: float = 0.35
    relative_radius: float = 0.4
    maximum_blobs: int = 100

    def __post_init__(self) -> None:
        if self.threshold is not None and not 1.0 <= self.threshold <= 250.0:
            raise SettingsError(f"a threshold of {self.threshold:g} grey levels cannot be", advice="use 1 to 250")
        if self.sigmas < 0.0 or not 0 <= self.dilation_px <= 10 or self.maximum_blobs < 1:
            raise SettingsError("sigmas, dilation or number of blobs are out of range")
        if not 0.0 < self.minimum_radius_px < self.maximum_radius_px:
            raise SettingsError("the smallest marker radius must be positive and below the largest")


_LOWEST_AUTOMATIC_THRESHOLD = 12.0
_DIMMEST = 0.5  # of the limit that the last image set: what is below it is not even measured


class Detector:
    """Finds markers in the images of one camera.

    With an automatic threshold it keeps, from image to image, how bright this camera's markers are: cameras differ.
    """

    def __init__(self, background: Background | None = None, settings: DetectionSettings | None = None) -> None:
        self.settings = settings or DetectionSettings()
        self._usual_contrast = 0.0
        self._low: Image | None = None
        self._high: Image | None = None
        self._grey: Float32 | None = None
        self._threshold = self.settings.threshold or _LOWEST_AUTOMATIC_THRESHOLD
        self._size: tuple[int, int] | None = None
        if background is not None:
            if self.settings.threshold is None:
                self._threshold = max(_LOWEST_AUTOMATIC_THRESHOLD, self.settings.sigmas * background.noise)
            self._low, self._high = background.band(self.settings.sigmas, self._threshold)
            self._grey = _grey(background.mean)
            self._size = background.image_size

    @property
    def threshold(self) -> float:
        """Grey levels above the background from which a pixel may belong to a marker."""
        return self._threshold

    def foreground(self, image: Image) -> Image:
        """Return the mask (0 or 255) of pixels where any channel differs from the background, dilated."""
        if self._low is None or self._high is None:
            outside = cv2.subtract(image, np.full(3, self._threshold))
        else:
            # faster than cv2.inRange with bounds of each pixel
            outside = cv2.bitwise_or(cv2.subtract(image, self._high), cv2.subtract(self._low, image))
        blue, green, red = cv2.split(outside)
        mask = cv2.threshold(cv2.bitwise_or(cv2.bitwise_or(blue, green), red), 0, 255, cv2.THRESH_BINARY)[1]
        if self.settings.dilation_px:
            side = 2 * self.settings.dilation_px + 1
            mask = cv2.dilate(mask, np.ones((side, side), np.uint8))
        return np.asarray(mask, dtype=np.uint8)

    def detect(self, image: Image) -> Float32:
        """Return blobs (n, 5): x, y (pixels), radius_px, brightness 0-255, hue 0-180; brightest first.

        Raises:
            CaptureError: the image's size is not the background's.
        """
        if self._size is not None and (image.shape[1], image.shape[0]) != self._size:
            raise CaptureError(
                f"the image is {image.shape[1]}x{image.shape[0]}, its background {self._size[0]}x{self._size[1]}",
                advice="learn the background again",
            )
        foreground = self.foreground(image)
        x, y, width, height = cv2.boundingRect(foreground)
        if width == 0:
            return self._chosen([])
        count, components, stats = _components(foreground[y : y + height, x : x + width])
        dimmest = max(self._threshold, _DIMMEST * self.settings.relative_brightness * self._usual_contrast)
        blobs: list[_Blob] = []
        for index, may_be_marker in _candidates(stats, count, self.settings):
            left, top, width, height = (int(v) for v in stats[index, :4])
            mask = components[top : top + height, left : left + width] == index
            left, top = left + x, top + y
            window = (slice(top, top + height), slice(left, left + width))
            colours = image[window]
            grey = _grey(colours)
            contrast = np.where(mask, grey if self._grey is None else grey - self._grey[window], np.float32(0.0))
            if contrast.max() < dimmest:
                continue
            found = self._measure(colours, contrast, left, top) if may_be_marker else []
            # what is no marker as a whole is the performer, or a part, who wears some
            blobs += found or self._measure_on_body(colours, grey, contrast, left, top)
        return self._chosen(blobs)

    def _measure_on_body(
        self, colours: Image, grey: Float32, above_background: Float32, left: int, top: int
    ) -> "list[_Blob]":
        """Markers on a performer in a lit room: bright spots on a component too large to be a marker itself."""
        contrast = cv2.morphologyEx(grey, cv2.MORPH_TOPHAT, _SPOT_KERNEL)
        # what is no brighter than the empty room is the room beside a limb
        contrast = np.where(above_background >= self._threshold, contrast, np.float32(0.0))
        bright = (contrast >= max(self._threshold, _LOWEST_SPOT_CONTRAST)).view(np.uint8)
        count, parts, stats = _components(np.asarray(cv2.dilate(bright, np.ones((3, 3), np.uint8)), dtype=np.uint8))
        blobs = []
        for index, _ in _candidates(stats, count, self.settings):
            x, y, width, height = (int(v) for v in stats[index, :4])
            box = (slice(y, y + height), slice(x, x + width))
            part = _above_skin(np.where(parts[box] == index, contrast[box], np.float32(0.0)))
            blob = _blob(colours[box], part, left + x, top + y)
            pieces = _split(part, float(part.max())) if blob.roundness < _ROUND_ENOUGH else []
            blobs += [_blob(colours[box], piece, left + x, top + y) for piece in pieces] or [blob]
        brightest = sorted((blob.brightness for blob in blobs), reverse=True)[:_USUAL_MARKERS]
        limit = _SPOT_BRIGHTNESS * float(np.median(brightest)) if brightest else 0.0
        return self._fitting([blob for blob in blobs if blob.brightness >= limit])

    def _fitting(self, blobs: "list[_Blob]") -> "list[_Blob]":
        s = self.settings
        return [
            b
            for b in blobs
            if s.minimum_radius_px <= b.radius <= s.maximum_radius_px and b.roundness >= s.minimum_roundness
        ]

    def _measure(self, colours: Image, contrast: Float32, left: int, top: int) -> "list[_Blob]":
        contrast = np.maximum(contrast, np.float32(0.0))
        peak = float(contrast.max())
        if peak < self._threshold:
            return []
        blob = _blob(colours, contrast, left, top)
        if blob.roundness >= _ROUND_ENOUGH:
            parts = [blob]
        else:
            parts = [_blob(colours, part, left, top) for part in _split(contrast, peak)] or [blob]
        return self._fitting(parts)

    def _chosen(self, blobs: "list[_Blob]") -> Float32:
        blobs.sort(key=lambda blob: -blob.contrast)
        if not blobs:
            self._usual_contrast *= _MEMORY
        elif self.settings.threshold is None:
            top = float(np.median([blob.contrast for blob in blobs[:_USUAL_MARKERS]]))
            # follows at once when markers come nearer and get brighter, slowly when they leave or go dim
            self._usual_contrast = max(top, _MEMORY * self._usual_contrast)
            limit = self.settings.relative_brightness * min(top, self._usual_contrast)
            blobs = [blob for blob in blobs if blob.contrast >= limit]
        if blobs:
            usual_radius = float(np.median([blob.radius for blob in blobs]))
            blobs = [blob for blob in blobs if blob.radius >= self.settings.relative_radius * usual_radius]
        rows = [(b.x, b.y, b.radius, b.brightness, b.hue) for b in blobs[: self.settings.maximum_blobs]]
        return np.array(rows, dtype=np.float32).reshape(-1, 5)


@dataclass(frozen=True)
class _Blob:
    x: float
    y: float
    radius: float
    brightness: float
    hue: float
    contrast: float
    roundness: float


def _components(mask: Image) -> tuple[int, NDArray[np.uint16], NDArray[np.int32]]:
    """Return number, labels and boxes with areas of a mask's connected parts; the first is the background."""
    # 16-bit labels and this algorithm are three times as fast as the default
    count, labels, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(mask, 8, cv2.CV_16U, cv2.CCL_GRANA)
    return count, np.asarray(labels, dtype=np.uint16), np.asarray(stats, dtype=np.int32)


def _candidates(stats: NDArray[np.int32], count: int, settings: DetectionSettings) -> list[tuple[int, bool]]:
    """Components to look at, and whether their box could hold a marker, or two that touch, and nothing else."""
    if count <= 1:
        return []
    sides = stats[1:, 2:4] - 2 * settings.dilation_px
    small = sides.max(axis=1) < max(1.0, 2.0 * settings.minimum_radius_px - 1.0)
    large = sides.max(axis=1) > 4.0 * settings.maximum_radius_px
    return [(int(i) + 1, not large[i]) for i in np.flatnonzero(~small)]


def _grey(colours: NDArray[np.uint8] | Float32) -> Float32:
    """Mean of the channels; markers of any colour count alike."""
    if colours.dtype != np.uint8:
        return np.asarray(colours.mean(axis=2, dtype=np.float32))
    values = colours.astype(np.float32)
    return np.asarray((values[..., 0] + values[..., 1] + values[..., 2]) * np.float32(1.0 / 3.0))


def _blob(colours: Image, contrast: Float32, left: int, top: int) -> _Blob:
    """Measure one blob from its contrast above the background (zero outside it)."""
    # the plain centroid suffers from what the rim lacks, higher powers from how the peak falls on the pixels: of discs
    # of 1.5 to 6 pixels 1.3 has the least error
    weights = contrast ** np.float32(1.3)
    moments = cv2.moments(weights.astype(np.float64))  # two columns of 32 bits would be taken for a list of points
    total = moments["m00"]
    x, y = moments["m10"] / total, moments["m01"] / total
    spread_x, spread_y, spread_xy = (moments[name] / total for name in ("mu20", "mu02", "mu11"))
    mean, half = 0.5 * (spread_x + spread_y), math.hypot(0.5 * (spread_x - spread_y), spread_xy)
    # a pixel's own extent (1/12) keeps the ratio of the smallest blobs in bounds
    roundness = math.sqrt(max(mean - half, 0.0) + 1 / 12) / math.sqrt(mean + half + 1 / 12)
    values = np.sort(contrast[contrast > 0.0])
    eighth = max(1, len(values) // 8)
    plateau = float(values[-eighth:].sum(dtype=np.float64)) / eighth
    radius = math.sqrt(float(values.sum(dtype=np.float64)) / (math.pi * plateau))
    colour = cv2.mean(colours, (contrast >= 0.5 * plateau).view(np.uint8))[:3]
    return _Blob(left + x, top + y, radius, max(colour), _hue(colour), plateau, roundness)


def _hue(bgr: Sequence[float]) -> float:
    """Hue of a BGR colour, 0 to 180 as in OpenCV; 0 for grey."""
    blue, green, red = bgr
    high, low = max(blue, green, red), min(blue, green, red)
    if high - low < 1e-6:
        return 0.0
    if high == red:
        sixth = (green - blue) / (high - low)
    elif high == green:
        sixth = 2.0 + (blue - red) / (high - low)
    else:
        sixth = 4.0 + (red - green) / (high - low)
    return (sixth * 30.0) % 180.0


def _above_skin(contrast: Float32) -> Float32:
    """Return what rises above the body in a spot's window.

    Where a thin part of the body (a hand) stands out from what is behind it as well, two levels are found, skin and
    marker; what lies below the middle of the two is skin. Else only the lowest part, the rim, is taken off.
    """
    values = contrast[contrast > 0.0]
    level = _RIM_SHARE * float(values.max())
    middle = 0.5 * float(values.max() + values.min())
    ordered = np.sort(values)
    sums = np.cumsum(ordered)
    below, total, count = 0, float(sums[-1]), len(ordered)
    low = high = 0.0
    for _ in range(8):  # two means, of the values below and above their middle
        split = int(ordered.searchsorted(np.float32(middle)))
        if split in (0, count, below):
            break
        below = split
        low, high = float(sums[below - 1]) / below, (total - float(sums[below - 1])) / (count - below)
        middle = 0.5 * (low + high)
    if below > 1.2 * (count - below):
        level = low + 0.35 * (high - low)
    return np.maximum(contrast - np.float32(level), np.float32(0.0))


def _split(contrast: Float32, peak: float) -> list[Float32]:
    """Take apart markers that touch. Empty when there is one only.

    At some higher level of brightness they are separate; flat discs, which overlap without a valley, are where
    the blob is narrower between them than across each.
    """
    inside = cv2.distanceTransform((contrast >= 0.5 * peak).astype(np.uint8), cv2.DIST_L2, 5)
    levels = [contrast >= level * peak for level in _SPLIT_LEVELS]
    levels += [inside >= level * inside.max() for level in _NECK_LEVELS]
    for mask in levels:
        count, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
        sizes = np.bincount(parts.ravel(), minlength=count)[1:]
        large = [i + 1 for i, size in enumerate(sizes) if size >= max(3, 0.15 * sizes.max())]
        if len(large) >= 2:
            distances = np.stack([_distance_to(parts == i) for i in large])
            nearest = distances.argmin(axis=0)
            return [np.where(nearest == i, contrast, np.float32(0.0)) for i in range(len(large))]
    return []


def _distance_to(mask: NDArray[np.bool_]) -> Float32:
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3), dtype=np.float32)
