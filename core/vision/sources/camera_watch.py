"""Health of one camera, by the times and content of its images."""

from collections import deque

import numpy as np

from ...geometry.arrays import Image, Mask, runs

# Reported within a quarter of a second; the rest of it is for the way to the panel.
_SILENT_S = 0.12
_SILENT_PERIODS = 2.5  # slow cameras are silent between two images
_STALE_S = 0.1
_TOO_OFTEN = 0.6  # periods between images of a camera that runs at another rate
_BLACK_LEVEL = 24  # grey levels: above the noise of a covered sensor
_CONTRAST = 2  # what has been so many times brighter than black can become black
_COMPARED_ROWS = 16  # every so many rows of pixels one is compared
_FRESH_IMAGES = 60  # in a row, so long is a row never the same where a sensor's noise shows
_TORN_ROWS = 4  # compared rows beside each other that are the last image's
_TEARS, _TEARS_S = 2, 0.5  # torn images, and within which time they are reported


class CameraHealth:
    """Health of a camera: frozen, gone, black, changed, torn, or repeating an image.

    Args:
        is_compressed: an encoder copies rows of the last image as it likes, so torn images are not looked for.
    """

    def __init__(
        self, title: str, period_s: float, now_s: float, shape: tuple[int, ...], is_compressed: bool = False
    ) -> None:
        self._title = title
        self._period_s, self._shape = period_s, shape
        self._patience_s = max(_SILENT_S, _SILENT_PERIODS * period_s)
        self._last_s = now_s
        self._last: Image | None = None
        self._has_shown = False
        self._repeats_since_s: float | None = None
        self._black_since_s: float | None = None
        self._often_since_s: float | None = None
        self._is_resized = False
        self._tears = _TearWatch()
        self._is_compressed = is_compressed

    def update(self, time_s: float, image: Image) -> bool:
        """Take the next image; return whether it shows something new."""
        too_often = 0.0 <= time_s - self._last_s < _TOO_OFTEN * self._period_s
        self._often_since_s = _since(self._often_since_s, time_s, too_often)
        self._last_s, self._is_resized = time_s, image.shape != self._shape
        same_rows = _same_rows(self._last, image)
        repeated = self._last is not None and bool(same_rows.all()) and np.array_equal(self._last, image)
        if not self._is_compressed:
            self._tears.update(time_s, same_rows)
        brightest = int(image.max())
        black = self._has_shown and brightest < _BLACK_LEVEL
        self._has_shown = self._has_shown or brightest >= _CONTRAST * _BLACK_LEVEL
        self._last = image
        # a sensor has noise, so an image that is the last one once more is no new image; black can be all zeros
        self._repeats_since_s = _since(self._repeats_since_s, time_s, repeated and not black)
        self._black_since_s = _since(self._black_since_s, time_s, black)
        return not (repeated or black or self._is_resized)

    def is_silent(self, now_s: float) -> bool:
        """Return whether images should have come by now."""
        return now_s - self._last_s > self._patience_s

    def comes_often(self, now_s: float) -> bool:
        """Return whether images come much faster than the first camera's rate."""
        return self._often_since_s is not None and now_s - self._often_since_s > _STALE_S

    def note(self, now_s: float, gone: bool = False, uneven: bool = False) -> str:
        """Return a description of the fault, "" without one.

        `uneven`: not all cameras' images come too often, as they do where a driver gives a wrong rate.
        """
        if self.is_silent(now_s):
            return f"{self._title} is gone, check its cable" if gone else f"{self._title} froze"
        if self._is_resized:
            return f"{self._title} gives images of another size, close other programs that use it"
        if uneven and self.comes_often(now_s):
            return f"{self._title} gives images too often, set all cameras to one rate"
        if self._black_since_s is not None and now_s - self._black_since_s > _STALE_S:
            return f"{self._title} is black, check its lens cap and the lamp"
        if self._repeats_since_s is not None and now_s - self._repeats_since_s > _STALE_S:
            return f"{self._title} repeats one image"
        if self._tears.are_many(now_s):
            return f"{self._title} gives torn images, choose a lower rate or size, or another USB port"
        return ""


class _TearWatch:
    """Watch for images with the lower part of the last image.

    Found by rows of pixels that were never the same as in the last image, as a sensor has noise, and are so now while
    others are not. An edge that stays at one height is not seen: there, the lower part is always one image late.
    """

    def __init__(self) -> None:
        self._fresh_images = np.zeros(0, dtype=int)  # per row, in a row
        self._same_rows: Mask = np.zeros(0, dtype=bool)  # of the last image
        self._times_s: deque[float] = deque(maxlen=_TEARS)

    def update(self, time_s: float, same_rows: Mask) -> None:
        """Take the next image's mask (N,) of rows that are the last image's."""
        if len(same_rows) != len(self._fresh_images):
            self._fresh_images, self._same_rows = np.zeros(len(same_rows), dtype=int), same_rows
        if same_rows.all():
            return  # the last image once more
        torn = same_rows & ~self._same_rows & (self._fresh_images >= _FRESH_IMAGES)
        is_torn = any(stop - start >= _TORN_ROWS for start, stop in runs(torn))
        if is_torn:
            self._times_s.append(time_s)
        self._fresh_images[~same_rows] += 1
        self._fresh_images[same_rows & ~(torn & is_torn)] = 0
        self._same_rows = same_rows

    def are_many(self, now_s: float) -> bool:
        """Return whether several of the latest images were torn."""
        return len(self._times_s) == _TEARS and now_s - self._times_s[0] < _TEARS_S


def is_repeated(last: Image, image: Image) -> bool:
    """Return whether an image is exactly the one before it."""
    return bool(_same_rows(last, image).all()) and np.array_equal(last, image)


def _same_rows(last: Image | None, image: Image) -> Mask:
    """Return a mask (N,) of the compared rows that are the last image's."""
    if last is None or last.shape != image.shape:
        return np.zeros(len(image[::_COMPARED_ROWS]), dtype=bool)
    return np.all(last[::_COMPARED_ROWS] == image[::_COMPARED_ROWS], axis=tuple(range(1, image.ndim)))


def _since(start_s: float | None, now_s: float, holds: bool) -> float | None:
    """Return since when something holds that held since `start_s`."""
    if not holds:
        return None
    return now_s if start_s is None else start_s
