"""Markers in one image: blobs in the foreground with sub-pixel centres."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from ...errors import CaptureError, SettingsError
from ...geometry.arrays import Array, FloatArray, Image, IntArray, Mask
from .background import Background
from .blob_measurement import (
    BRIGHTNESS,
    COLUMNS,
    CONTRAST,
    HUE,
    NO_PIXELS,
    RADIUS,
    ROUNDNESS,
    BlobPixels,
    X,
    Y,
    blob_pixels,
    group_of,
    join_groups,
    measure_apart,
    subtract_skin,
)

_MEMORY = 0.9  # per frame, of the automatic threshold
_USUAL_MARKERS = 8
_SPOT_KERNEL = np.ones((11, 11), np.uint8)  # wider than a marker on a performer who is seen whole at 640x480
_LOWEST_SPOT_CONTRAST = 40.0  # against the body, which is lit and creased
_SPOT_BRIGHTNESS = 0.85  # of the usual spot's: reflectors are brighter than skin and cloth


@dataclass(frozen=True)
class DetectionSettings:
    """How markers are found.

    Args:
        threshold: grey levels by which a pixel must differ from the background; None: found automatically.
        dilation_px: growth of the foreground, so that the soft rim of a marker belongs to it.
        whole_every: of images larger than 640x480 one in so many is looked at as a whole, the others where the markers
            of the one before may have gone: a marker that comes from elsewhere is found so many images later.
    """

    threshold: float | None = None
    dilation_px: int = 1
    whole_every: int = 1

    def __post_init__(self) -> None:
        if self.threshold is not None and not 1.0 <= self.threshold <= 250.0:
            raise SettingsError(f"a threshold of {self.threshold:g} grey levels cannot be", advice="use 1 to 250")


_LOWEST_AUTOMATIC_THRESHOLD = 12.0
_SIGMAS = 6.0  # of a pixel, by which it must differ from the background as well
_SMALLEST_PX, _LARGEST_PX = 0.8, 12.0  # radius of a marker in the image
_LEAST_ROUNDNESS = 0.3  # ratio of a blob's short to its long axis: motion blur makes discs long
_RELATIVE_BRIGHTNESS = 0.35  # of the usual marker: a dimmer blob is no marker (automatic threshold)
_RELATIVE_RADIUS = 0.4  # the same of its radius: small glints of clothing are no markers
_MOST_BLOBS = 100  # brightest first
_SMALL_IMAGE = 640 * 480  # pixels, up to which the whole image is looked at every time
_REACH = 0.08  # of the longer side: a marker 2 m away goes so far in a sixtieth of a second at 10 m/s
_IGNORED_SHARE = 0.01  # of the image's width: a reflection flickers, and its centre moves a little
_DIMMEST = 0.5  # of the limit that the last image set: blobs below it are not even measured


def ignored_radius_px(image_width: int) -> float:
    """Return the radius around an ignored place without markers."""
    return _IGNORED_SHARE * image_width


class Detector:
    """Finds markers in the images of one camera.

    With an automatic threshold it keeps, from image to image, how bright this camera's markers are: cameras differ.

    Args:
        ignored_px: (N, 2) places of reflections; what lies within `ignored_radius_px` of one counts as no marker.
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
        # grey levels above the background of a marker's pixels
        self.threshold = self.settings.threshold or _LOWEST_AUTOMATIC_THRESHOLD
        self._size: tuple[int, int] | None = None
        self._last = np.empty((0, 5), dtype=np.float32)
        self._partly = 0  # images in a row that were not looked at as a whole
        if background is not None:
            if self.settings.threshold is None:
                self.threshold = max(_LOWEST_AUTOMATIC_THRESHOLD, _SIGMAS * background.noise)
            low, high = background.band(_SIGMAS, self.threshold)
            light = background.mean.sum(axis=2)
            lit = np.ceil(light + 3.0 * self.threshold)
            self._room = _EmptyRoom(
                low, high - low, background.mean, np.rint(light).astype(np.uint16), lit.astype(np.uint16)
            )
            self._size = background.image_size

    def foreground(self, image: Image, part: "_EmptyRoom | None" = None) -> tuple[Image, int]:
        """Return the dilated mask (0 or 255) of pixels unlike the background, or a part.

        It has all rows, but only the columns from the first such pixel to the last; the second value is the first one.
        """
        outside, grown_px = self._unlike_room(image, part or self._room), self.settings.dilation_px
        height, width = image.shape[:2]
        columns = np.maximum.reduce(outside.reshape(height, -1)).nonzero()[0] // 3
        if not len(columns):
            return np.empty((height, 0), dtype=np.uint8), 0
        # a performer takes up a small part of the width
        left, right = max(int(columns[0]) - grown_px, 0), min(int(columns[-1]) + 1 + grown_px, width)
        blue, green, red = cv2.split(outside[:, left:right])
        mask = cv2.bitwise_or(cv2.bitwise_or(blue, green, dst=blue), red, dst=blue)
        if grown_px:
            mask = cv2.dilate(mask, np.ones((2 * grown_px + 1,) * 2, np.uint8))
        return np.asarray(mask, dtype=np.uint8), left

    def _unlike_room(self, image: Image, room: "_EmptyRoom | None") -> Image:
        if room is None:
            return np.asarray(cv2.threshold(image, self.threshold, 255, cv2.THRESH_BINARY)[1], dtype=np.uint8)
        # values below the band wrap around to above it; much faster than cv2.inRange with bounds of each pixel
        above_low = np.subtract(image, room.low)
        return np.asarray(cv2.compare(above_low, room.width, cv2.CMP_GT, dst=above_low), dtype=np.uint8)

    def detect(self, image: Image) -> FloatArray:
        """Return blobs (n, 5): x, y, radius_px, brightness, hue; brightest first.

        Raises:
            CaptureError: the image's size is not the background's.
        """
        if self._size is not None and (image.shape[1], image.shape[0]) != self._size:
            raise CaptureError(
                f"the image is {image.shape[1]}x{image.shape[0]}, its background {self._size[0]}x{self._size[1]}",
                advice="learn the background again",
            )
        window = self._window(image)
        if window is None:
            self._partly = 0
            found = self._select(self._without_ignored(self._found(image, self._room), image.shape[1]))
        else:
            self._partly += 1
            found = self._select(self._without_ignored(self._found_within(image, window), image.shape[1]))
        self._last = found
        return found

    def _without_ignored(self, table: Array, image_width: int) -> Array:
        """Return the candidates outside the ignored places."""
        if not len(self._ignored_px) or not len(table):
            return table
        distance = np.linalg.norm(table[:, None, [X, Y]] - self._ignored_px, axis=2).min(axis=1)
        return np.asarray(table[distance > ignored_radius_px(image_width)])

    def _window(self, image: Image) -> "_Window | None":
        """Return the part of a large image around the last markers; None: all of it."""
        height, width = image.shape[:2]
        if height * width <= _SMALL_IMAGE or self._partly + 1 >= self.settings.whole_every or len(self._last) == 0:
            return None
        reach = round(_REACH * max(height, width)) + self._rim
        left, top = np.maximum(self._last[:, :2].min(axis=0).astype(int) - reach, 0).tolist()
        right, bottom = (self._last[:, :2].max(axis=0).astype(int) + reach + 1).tolist()
        return slice(top, min(bottom, height)), slice(left, min(right, width))

    @property
    def _rim(self) -> int:
        """Pixels at the edge of a part of an image where a marker may be cut off."""
        return int(2.0 * _LARGEST_PX) + len(_SPOT_KERNEL)

    def _found_within(self, image: Image, window: "_Window") -> Array:
        """Return the blobs in a part of an image, without those at its inner edges."""
        rows, columns = window
        table = self._found(image[window], None if self._room is None else self._room.within(window))
        table[:, X] += columns.start
        table[:, Y] += rows.start
        height, width = image.shape[:2]
        inside = np.ones(len(table), dtype=bool)
        for place, part, size in ((table[:, X], columns, width), (table[:, Y], rows, height)):
            inside &= (place >= part.start + self._rim) | (part.start == 0)
            inside &= (place < part.stop - self._rim) | (part.stop == size)
        return table[inside]

    def _found(self, image: Image, room: "_EmptyRoom | None") -> Array:
        """Return marker candidates in an image, or in a part of image and room."""
        dimmest = max(self.threshold, _DIMMEST * _RELATIVE_BRIGHTNESS * self._usual_contrast)
        parts = _parts(*self.foreground(image, room), self.settings.dilation_px)
        alone, bodies = self._measure_alone(image, room, [part for part in parts if part.may_be_marker], dimmest)
        # the other parts are of the performer, with markers on them
        bodies += [part for part in parts if not part.may_be_marker]
        return np.concatenate((alone, self._measure_on_bodies(image, room, bodies, dimmest)))

    def _measure_alone(
        self, image: Image, room: "_EmptyRoom | None", parts: "list[_Component]", dimmest: float
    ) -> "tuple[Array, list[_Component]]":
        """Return markers among foreground parts, and bright parts that are none."""
        if not parts:
            return np.empty((0, COLUMNS)), []
        owner, x, y = _pixels(parts)
        colours = image[y, x]
        rise = colours.astype(np.float32)
        if room is not None:
            rise -= room.mean[y, x]
        if rise.max() < dimmest:  # which no mean of the channels exceeds: noise and shadows
            return np.empty((0, COLUMNS)), []
        contrast = _contrast(rise, owner, len(parts))
        bright = np.zeros(len(parts), dtype=bool)
        bright[owner[contrast >= dimmest]] = True
        kept = bright[owner]
        owners, table = measure_apart(blob_pixels(owner[kept], x[kept], y[kept], contrast[kept], colours[kept]))
        fitting = _fits(table)
        bright[owners[fitting]] = False
        return table[fitting], [parts[i] for i in np.flatnonzero(bright)]

    def _measure_on_bodies(
        self, image: Image, room: "_EmptyRoom | None", bodies: "list[_Component]", dimmest: float
    ) -> Array:
        """Return the markers on parts of the foreground that are no markers as a whole."""
        spots = [self._spots(image, room, body, dimmest) for body in bodies]
        if not spots:
            return np.empty((0, COLUMNS))
        owners, table = measure_apart(subtract_skin(join_groups(spots)))
        fitting = _fits(table)
        body = group_of(owners)
        for number in range(len(spots)):
            brightest = np.sort(table[body == number, BRIGHTNESS])[-_USUAL_MARKERS:].tolist()
            limit = _SPOT_BRIGHTNESS * median(brightest) if brightest else 0.0
            fitting[(body == number) & (table[:, BRIGHTNESS] < limit)] = False
        return table[fitting]

    def _spots(self, image: Image, room: "_EmptyRoom | None", body: "_Component", dimmest: float) -> BlobPixels:
        """Return bright spots on a performer in a lit room."""
        window = body.window
        light = _light(image[window])
        above_background = light if room is None else cv2.subtract(light, room.light[window])
        if not np.any(body.inside & (above_background >= 3.0 * dimmest)):
            return NO_PIXELS
        contrast = cv2.morphologyEx(light, cv2.MORPH_TOPHAT, _SPOT_KERNEL)
        # pixels no brighter than the empty room are the room beside a limb
        lit = body.inside & (light >= (3.0 * self.threshold if room is None else room.lit[window]))
        bright = lit & (contrast >= 3.0 * max(self.threshold, _LOWEST_SPOT_CONTRAST))
        spots = np.asarray(cv2.dilate(bright.view(np.uint8), np.ones((3, 3), np.uint8)), dtype=np.uint8)
        places = np.flatnonzero(lit & spots.view(bool))  # of two axes `nonzero` takes ten times as long
        if not len(places):
            return NO_PIXELS
        y, x = np.divmod(places, light.shape[1])
        third = np.float32(1.0 / 3.0)
        owner = _labels(spots)[y, x].astype(np.int64)  # which is multiplied
        return blob_pixels(owner, x + body.left, y + body.top, contrast[y, x] * third, image[window][y, x])

    def _select(self, table: Array) -> FloatArray:
        # sums have no more digits: the equally bright stay in the order of the image's rows
        table = table[np.argsort(-table[:, CONTRAST].round(6), kind="stable")]
        if len(table) == 0:
            self._usual_contrast *= _MEMORY
        elif self.settings.threshold is None:
            top = median(table[:_USUAL_MARKERS, CONTRAST].tolist())
            # follows at once when markers come nearer and get brighter, slowly when they leave or go dim
            self._usual_contrast = max(top, _MEMORY * self._usual_contrast)
            limit = _RELATIVE_BRIGHTNESS * min(top, self._usual_contrast)
            table = table[table[:, CONTRAST] >= limit]
        if len(table):
            usual_radius = median(table[:, RADIUS].tolist())
            table = table[table[:, RADIUS] >= _RELATIVE_RADIUS * usual_radius]
        return table[:_MOST_BLOBS, (X, Y, RADIUS, BRIGHTNESS, HUE)].astype(np.float32)


def _fits(table: Array) -> Mask:
    """Return the rows that may be of markers, by size and shape."""
    radius = table[:, RADIUS]
    inside = (radius >= _SMALLEST_PX) & (radius <= _LARGEST_PX)
    return np.asarray(inside & (table[:, ROUNDNESS] >= _LEAST_ROUNDNESS))


_Window = tuple[slice, slice]


@dataclass(frozen=True)
class _EmptyRoom:
    """The empty room.

    Args:
        low, width: (h, w, 3) least value of each pixel and channel that is still background, and how far up it goes.
        mean: (h, w, 3) grey levels.
        light: (h, w) sum of the channels.
        lit: (h, w) the same where it has risen by the threshold.
    """

    low: Image
    width: Image
    mean: FloatArray
    light: NDArray[np.uint16]
    lit: NDArray[np.uint16]

    def within(self, window: _Window) -> "_EmptyRoom":
        """Return a part of it."""
        return _EmptyRoom(self.low[window], self.width[window], self.mean[window], self.light[window], self.lit[window])


@dataclass(frozen=True)
class _Component:
    """A connected part of a mask.

    Args:
        left, top: where its box begins.
        inside: (h, w) which pixels of the box belong to it.
        may_be_marker: whether the box could hold a marker, or two that touch, and nothing else.
    """

    left: int
    top: int
    inside: Mask
    may_be_marker: bool

    @property
    def window(self) -> _Window:
        """The box in its image."""
        height, width = self.inside.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)


def _parts(mask: Image, first_column: int, dilation_px: int) -> list[_Component]:
    """Return connected parts of a dilated mask, large enough for a marker."""
    # contours and labels within their boxes take half the time of labels with statistics of the whole image
    contours, hierarchy = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    parts = []
    for contour, (_, _, _, parent) in zip(contours, hierarchy[0].tolist() if contours else (), strict=True):
        if parent >= 0:  # the rim of a hole
            continue
        left, top, width, height = cv2.boundingRect(contour)
        side = max(width, height) - 2 * dilation_px
        if side < max(1.0, 2.0 * _SMALLEST_PX - 1.0):
            continue
        labels = _labels(mask[top : top + height, left : left + width])
        x, y = contour[0, 0]
        inside = labels == labels[y - top, x - left]
        parts.append(_Component(first_column + left, top, inside, side <= 4.0 * _LARGEST_PX))
    return parts[::-1]  # contours come from the last row to the first


def _labels(mask: Image) -> NDArray[np.int32]:
    """Return the number of the connected part that each pixel belongs to, 0 for none."""
    labels = cv2.connectedComponentsWithAlgorithm(mask, 8, cv2.CV_32S, cv2.CCL_BOLELLI)[1]
    return np.asarray(labels, dtype=np.int32)


def _pixels(parts: Sequence[_Component]) -> tuple[IntArray, IntArray, IntArray]:
    """Return part, x and y of each pixel (P,) of some parts."""
    places = [part.inside.nonzero() for part in parts]
    owner = np.repeat(np.arange(len(parts)), [len(rows) for rows, _ in places])
    x = np.concatenate([columns + part.left for part, (_, columns) in zip(parts, places, strict=True)])
    y = np.concatenate([rows + part.top for part, (rows, _) in zip(parts, places, strict=True)])
    return owner, x, y


def _contrast(rise: FloatArray, owner: IntArray, parts: int) -> FloatArray:
    """Return the light (P,) of pixels above the empty room, grey levels.

    Channels count as much as they are brighter in the whole part: a white marker's alike, of a red one the red channel
    alone, or the others, darker than a lit wall's, would outweigh it.

    Args:
        rise: (P, 3) pixels less the empty room.
        owner: (P,) which part each is of.
    """
    more = np.maximum(rise, 0.0)
    totals = np.stack([np.bincount(owner, channel, parts) for channel in more.T], axis=1)
    shares = totals / np.maximum(totals.sum(axis=1, keepdims=True), 1.0)
    return np.asarray(np.einsum("pc,pc->p", rise, shares.astype(np.float32)[owner]))


def _light(colours: Image) -> NDArray[np.uint16]:
    """Sum of the channels (h, w, 3): three times the grey level, without rounding."""
    blue, green, red = cv2.split(colours)
    light: NDArray[np.uint16] = np.add(blue, green, dtype=np.uint16)
    light += np.asarray(red, dtype=np.uint8)
    return light
