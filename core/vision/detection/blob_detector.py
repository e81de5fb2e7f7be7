"""Detection of markers in one image: blobs in the foreground with sub-pixel centres."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from ...errors import CaptureError, SettingsError
from ...geometry.arrays import Array, FloatArray, Image, IntArray, Mask
from . import blob_measurement as blobs
from .background import Background
from .foreground import differing


@dataclass(frozen=True)
class DetectionSettings:
    """Settings for finding markers; lengths are in pixels, light is in grey levels."""

    threshold: float | None = None  # smallest difference of a marker's pixel from the background; None: automatic
    dilation_px: int = 1  # growth of the foreground, so that it includes the soft rims of markers
    # Every nth image larger than `small_image` is searched completely, the others near the last markers: a marker
    # that comes from elsewhere is found up to n images later.
    whole_every: int = 1
    small_image: int = 640 * 480
    # search range around the last markers, share of the longer side; enough for 10 m/s at a distance of 2 m and 60 Hz
    reach: float = 0.08
    lowest_threshold: float = 12.0  # smallest automatic threshold
    sigmas: float = 6.0  # smallest difference of a pixel from the background, in its standard deviations
    smallest_px: float = 0.8  # smallest radius of a marker
    largest_px: float = 12.0
    least_roundness: float = 0.3  # ratio of a blob's short to its long axis; motion blur makes discs long
    relative_brightness: float = 0.35  # smallest brightness relative to a typical marker's (automatic threshold)
    relative_radius: float = 0.4  # smallest radius relative to a typical marker's, against small glints on clothing
    dimmest: float = 0.5  # share of the last image's brightness limit; blobs below it are not measured
    memory: float = 0.9  # factor by which the typical brightness decays per image
    usual_markers: int = 8  # number of the brightest markers, whose median is the typical brightness
    most_blobs: int = 100  # largest number of blobs; the brightest are kept
    # side of the square within which a spot must stand out; wider than any marker when a 640x480 image shows the whole
    # performer
    spot_px: int = 11
    spot_contrast: float = 40.0  # smallest contrast of a spot against the body, on which lit creases stand out
    spot_brightness: float = 0.85  # smallest brightness relative to a typical spot's; skin and cloth are darker
    # radius around an ignored position, share of the image's width; above zero, because reflections move
    ignored_share: float = 0.01

    def __post_init__(self) -> None:
        if self.threshold is not None and not 1.0 <= self.threshold <= 250.0:
            raise SettingsError(f"the threshold {self.threshold:g} is out of range", advice="use 1 to 250")

    @property
    def rim_px(self) -> int:
        """Width of the border of an image part in which a marker may be cut off."""
        return int(2.0 * self.largest_px) + self.spot_px


def ignored_radius_px(image_width: int, settings: DetectionSettings = DetectionSettings()) -> float:
    """Return the radius, in pixels, around an ignored position within which blobs are discarded."""
    return settings.ignored_share * image_width


class Detector:
    """Search for markers in the images of one camera.

    With an automatic threshold it remembers how bright this camera's markers are.

    Args:
        ignored_px: Positions (N, 2) of reflections; blobs near them are discarded.
    """

    def __init__(
        self,
        background: Background | None = None,
        settings: DetectionSettings | None = None,
        ignored_px: Array | None = None,
    ) -> None:
        self.settings = settings or DetectionSettings()
        self._ignored_px = np.empty((0, 2)) if ignored_px is None else ignored_px
        self._usual_contrast = 0.0
        self._room: _EmptyRoom | None = None
        # difference of a marker's pixels from the background, grey levels
        self.threshold = self.settings.threshold or self.settings.lowest_threshold
        self._size: tuple[int, int] | None = None
        self._last = np.empty((0, 5), dtype=np.float32)
        self._partly = 0  # number of successive images that were searched only in part
        if background is not None:
            if self.settings.threshold is None:
                self.threshold = max(self.settings.lowest_threshold, self.settings.sigmas * background.noise)
            low, high = background.band(self.settings.sigmas, self.threshold)
            light = background.mean.sum(axis=2)
            lit = np.ceil(light + 3.0 * self.threshold)
            self._room = _EmptyRoom(
                low, high - low, background.mean, np.rint(light).astype(np.uint16), lit.astype(np.uint16)
            )
            self._size = background.image_size

    def foreground(self, image: Image, part: "_EmptyRoom | None" = None) -> tuple[Image, int]:
        """Return the dilated mask (0 or 255) of pixels that differ from the background, and its first column.

        The mask has all rows, but only the columns from the first such pixel to the last.

        Args:
            part: Empty room behind a part of the image.
        """
        room, grown_px = part or self._room, self.settings.dilation_px
        low, band = (room.low, room.width) if room else (np.zeros_like(image), np.full_like(image, int(self.threshold)))
        mask, first, last = differing(image, low, band)
        if last < 0:
            return mask[:, :0], 0
        left = max(first - grown_px, 0)
        mask = mask[:, left : last + 1 + grown_px]
        if grown_px:
            mask = np.asarray(cv2.dilate(mask, np.ones((2 * grown_px + 1,) * 2, np.uint8)), dtype=np.uint8)
        return mask, left

    def detect(self, image: Image) -> FloatArray:
        """Return blobs (n, 5): x, y, radius_px, brightness, hue; brightest first.

        Raises:
            CaptureError: The image's size is not the background's.
        """
        height, width = image.shape[:2]
        if self._size is not None and (width, height) != self._size:
            raise CaptureError(
                f"the image is {width}x{height}, but its background is {self._size[0]}x{self._size[1]}",
                advice="learn the background again",
            )
        window = self._window(height, width)
        self._partly = 0 if window is None else self._partly + 1
        table = self._found(image, self._room) if window is None else self._found_within(image, window)
        if len(self._ignored_px) and len(table):
            distance = np.linalg.norm(table[:, None, [blobs.X, blobs.Y]] - self._ignored_px, axis=2).min(axis=1)
            table = table[distance > ignored_radius_px(width, self.settings)]
        self._last = self._select(table)
        return self._last

    def _window(self, height: int, width: int) -> "_Window | None":
        """Return the part of a large image around the last markers; None for the whole image."""
        is_whole = height * width <= self.settings.small_image or self._partly + 1 >= self.settings.whole_every
        if is_whole or len(self._last) == 0:
            return None
        reach = round(self.settings.reach * max(height, width)) + self.settings.rim_px
        left, top = np.maximum(self._last[:, :2].min(axis=0).astype(int) - reach, 0).tolist()
        right, bottom = (self._last[:, :2].max(axis=0).astype(int) + reach + 1).tolist()
        return slice(top, min(bottom, height)), slice(left, min(right, width))

    def _found_within(self, image: Image, window: "_Window") -> Array:
        """Return the candidates in a part of an image, except those at its inner edges."""
        rows, columns = window
        table = self._found(image[window], None if self._room is None else self._room.within(window))
        table[:, blobs.X] += columns.start
        table[:, blobs.Y] += rows.start
        height, width = image.shape[:2]
        inside, rim_px = np.ones(len(table), dtype=bool), self.settings.rim_px
        for place, part, size in ((table[:, blobs.X], columns, width), (table[:, blobs.Y], rows, height)):
            inside &= (place >= part.start + rim_px) | (part.start == 0)
            inside &= (place < part.stop - rim_px) | (part.stop == size)
        return table[inside]

    def _found(self, image: Image, room: "_EmptyRoom | None") -> Array:
        """Return the marker candidates in an image or a part of it; `room` is the empty room behind it."""
        settings = self.settings
        dimmest = max(self.threshold, settings.dimmest * settings.relative_brightness * self._usual_contrast)
        parts = _parts(*self.foreground(image, room), settings)
        alone, bodies = self._measure_alone(image, room, [part for part in parts if part.may_be_marker], dimmest)
        # the other parts are too large for markers, but may be performers with markers on them
        bodies += [part for part in parts if not part.may_be_marker]
        return np.concatenate((alone, self._measure_on_bodies(image, room, bodies, dimmest)))

    def _measure_alone(
        self, image: Image, room: "_EmptyRoom | None", parts: "list[_Component]", dimmest: float
    ) -> "tuple[Array, list[_Component]]":
        """Return the markers among foreground parts, and the bright parts that are not markers."""
        if not parts:
            return np.empty((0, blobs.COLUMNS)), []
        owner, x, y = _pixels(parts)
        colours = image[y, x]
        rise = colours.astype(np.float32)
        if room is not None:
            rise -= room.mean[y, x]
        if rise.max() < dimmest:  # noise and shadows
            return np.empty((0, blobs.COLUMNS)), []
        contrast = _contrast(rise, owner, len(parts))
        bright = np.zeros(len(parts), dtype=bool)
        bright[owner[contrast >= dimmest]] = True
        kept = bright[owner]
        owners, table = blobs.measure_apart(
            blobs.blob_pixels(owner[kept], x[kept], y[kept], contrast[kept], colours[kept])
        )
        fitting = self._fits(table)
        bright[owners[fitting]] = False
        return table[fitting], [parts[i] for i in np.flatnonzero(bright)]

    def _measure_on_bodies(
        self, image: Image, room: "_EmptyRoom | None", bodies: "list[_Component]", dimmest: float
    ) -> Array:
        """Return the markers on foreground parts that may be performers."""
        spots = [self._spots(image, room, body, dimmest) for body in bodies]
        if not spots:
            return np.empty((0, blobs.COLUMNS))
        owners, table = blobs.measure_apart(blobs.subtract_skin(blobs.join_groups(spots)))
        fitting = self._fits(table)
        body = blobs.group_of(owners)
        for number in range(len(spots)):
            brightest = np.sort(table[body == number, blobs.BRIGHTNESS])[-self.settings.usual_markers :].tolist()
            limit = self.settings.spot_brightness * median(brightest) if brightest else 0.0
            fitting[(body == number) & (table[:, blobs.BRIGHTNESS] < limit)] = False
        return table[fitting]

    def _spots(self, image: Image, room: "_EmptyRoom | None", body: "_Component", dimmest: float) -> blobs.BlobPixels:
        """Return bright spots on a performer in a lit room."""
        window = body.window
        light = _light(image[window])
        above_background = light if room is None else cv2.subtract(light, room.light[window])
        if not np.any(body.inside & (above_background >= 3.0 * dimmest)):
            return blobs.NO_PIXELS
        contrast = cv2.morphologyEx(light, cv2.MORPH_TOPHAT, np.ones((self.settings.spot_px,) * 2, np.uint8))
        # pixels no brighter than the empty room show the room next to a limb
        lit = body.inside & (light >= (3.0 * self.threshold if room is None else room.lit[window]))
        bright = lit & (contrast >= 3.0 * max(self.threshold, self.settings.spot_contrast))
        spots = np.asarray(cv2.dilate(bright.view(np.uint8), np.ones((3, 3), np.uint8)), dtype=np.uint8)
        places = np.flatnonzero(lit & spots.view(bool))  # `nonzero` over two axes takes ten times as long
        if not len(places):
            return blobs.NO_PIXELS
        y, x = np.divmod(places, light.shape[1])
        third = np.float32(1.0 / 3.0)
        owner = _labels(spots)[y, x].astype(np.int64)
        return blobs.blob_pixels(owner, x + body.left, y + body.top, contrast[y, x] * third, image[window][y, x])

    def _fits(self, table: Array) -> Mask:
        """Return the rows that have a marker's size and shape."""
        radius = table[:, blobs.RADIUS]
        inside = (radius >= self.settings.smallest_px) & (radius <= self.settings.largest_px)
        return np.asarray(inside & (table[:, blobs.ROUNDNESS] >= self.settings.least_roundness))

    def _select(self, table: Array) -> FloatArray:
        # rounding keeps equally bright blobs in the order of the image's rows
        table = table[np.argsort(-table[:, blobs.CONTRAST].round(6), kind="stable")]
        if len(table) == 0:
            self._usual_contrast *= self.settings.memory
        elif self.settings.threshold is None:
            top = median(table[: self.settings.usual_markers, blobs.CONTRAST].tolist())
            # follows at once if markers get brighter, slowly if they leave or get dimmer
            self._usual_contrast = max(top, self.settings.memory * self._usual_contrast)
            limit = self.settings.relative_brightness * min(top, self._usual_contrast)
            table = table[table[:, blobs.CONTRAST] >= limit]
        if len(table):
            usual_radius = median(table[:, blobs.RADIUS].tolist())
            table = table[table[:, blobs.RADIUS] >= self.settings.relative_radius * usual_radius]
        return table[: self.settings.most_blobs, (blobs.X, blobs.Y, blobs.RADIUS, blobs.BRIGHTNESS, blobs.HUE)].astype(
            np.float32
        )


_Window = tuple[slice, slice]


@dataclass(frozen=True)
class _EmptyRoom:
    """The empty room, or a part of it."""

    low: Image  # (h, w, 3) smallest background value of each pixel and channel
    width: Image  # (h, w, 3) largest background value minus `low`
    mean: FloatArray  # (h, w, 3)
    light: NDArray[np.uint16]  # (h, w) sum of the channels
    lit: NDArray[np.uint16]  # (h, w) `light` plus the threshold, summed over the channels

    def within(self, window: _Window) -> "_EmptyRoom":
        return _EmptyRoom(self.low[window], self.width[window], self.mean[window], self.light[window], self.lit[window])


@dataclass(frozen=True)
class _Component:
    """Connected component of a mask."""

    left: int
    top: int
    inside: Mask  # (h, w) pixels of the bounding box that belong to the component
    may_be_marker: bool  # the bounding box is small enough for a marker, or for two that touch

    @property
    def window(self) -> _Window:
        height, width = self.inside.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)


def _parts(mask: Image, first_column: int, settings: DetectionSettings) -> list[_Component]:
    """Return the connected components of a dilated mask that are large enough for a marker."""
    # contours, and labels within their boxes, take half the time of labels with statistics for the whole image
    contours, hierarchy = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    parts = []
    for contour, (_, _, _, parent) in zip(contours, hierarchy[0].tolist() if contours else (), strict=True):
        if parent >= 0:  # the rim of a hole
            continue
        left, top, width, height = cv2.boundingRect(contour)
        side = max(width, height) - 2 * settings.dilation_px
        if side < max(1.0, 2.0 * settings.smallest_px - 1.0):
            continue
        labels = _labels(mask[top : top + height, left : left + width])
        x, y = contour[0, 0]
        inside = labels == labels[y - top, x - left]
        parts.append(_Component(first_column + left, top, inside, side <= 4.0 * settings.largest_px))
    return parts[::-1]  # contours are listed from the last row to the first


def _labels(mask: Image) -> NDArray[np.int32]:
    """Return the number of each pixel's connected component, 0 outside the mask."""
    labels = cv2.connectedComponentsWithAlgorithm(mask, 8, cv2.CV_32S, cv2.CCL_BOLELLI)[1]
    return np.asarray(labels, dtype=np.int32)


def _pixels(parts: Sequence[_Component]) -> tuple[IntArray, IntArray, IntArray]:
    """Return the part, x and y (P,) of the pixels of several parts."""
    places = [part.inside.nonzero() for part in parts]
    owner = np.repeat(np.arange(len(parts)), [len(rows) for rows, _ in places])
    x = np.concatenate([columns + part.left for part, (_, columns) in zip(parts, places, strict=True)])
    y = np.concatenate([rows + part.top for part, (rows, _) in zip(parts, places, strict=True)])
    return owner, x, y


def _contrast(rise: FloatArray, owner: IntArray, parts: int) -> FloatArray:
    """Return the light (P,) of pixels above the empty room, grey levels.

    Channels are weighted by how much brighter they are in the whole part. Otherwise a red marker's blue and green,
    which are darker than a lit wall, would cancel its red.

    Args:
        rise: Pixels (P, 3) minus the empty room.
        owner: Part (P,) of each pixel.
    """
    more = np.maximum(rise, 0.0)
    totals = np.stack([np.bincount(owner, channel, parts) for channel in more.T], axis=1)
    shares = totals / np.maximum(totals.sum(axis=1, keepdims=True), 1.0)
    return np.asarray(np.einsum("pc,pc->p", rise, shares.astype(np.float32)[owner]))


def _light(colours: Image) -> NDArray[np.uint16]:
    """Return the sum of the channels (h, w): three times the grey level, without rounding."""
    blue, green, red = cv2.split(colours)
    light: NDArray[np.uint16] = np.add(blue, green, dtype=np.uint16)
    light += np.asarray(red, dtype=np.uint8)
    return light
