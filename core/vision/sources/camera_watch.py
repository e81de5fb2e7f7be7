"""Health of one camera, judged by the times and content of its images."""

from collections import deque

import numpy as np

from ...geometry.arrays import Image, Mask, runs
from .source_settings import SOURCES


class CameraHealth:
    """Health of a camera: frozen, gone, black, changed, torn, or repeating an image.

    Args:
        is_compressed: Images arrive compressed, so rows equal to the previous image's do not reveal a torn image.
    """

    def __init__(
        self, title: str, period_s: float, now_s: float, shape: tuple[int, ...], is_compressed: bool = False
    ) -> None:
        self._title = title
        self._period_s, self._shape = period_s, shape
        self._patience_s = max(SOURCES.silent_s, SOURCES.silent_periods * period_s)
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
        """Process the next image; return whether it shows something new."""
        too_often = 0.0 <= time_s - self._last_s < SOURCES.too_often * self._period_s
        self._often_since_s = _since(self._often_since_s, time_s, too_often)
        self._last_s, self._is_resized = time_s, image.shape != self._shape
        same_rows = _same_rows(self._last, image)
        repeated = self._last is not None and bool(same_rows.all()) and np.array_equal(self._last, image)
        if not self._is_compressed:
            self._tears.update(time_s, same_rows)
        brightest = int(image.max())
        black = self._has_shown and brightest < SOURCES.black_level
        self._has_shown = self._has_shown or brightest >= SOURCES.contrast * SOURCES.black_level
        self._last = image
        # a sensor has noise, so an identical image is not a new one; black images can be all zeros
        self._repeats_since_s = _since(self._repeats_since_s, time_s, repeated and not black)
        self._black_since_s = _since(self._black_since_s, time_s, black)
        return not (repeated or black or self._is_resized)

    def is_silent(self, now_s: float) -> bool:
        """Return whether images should have arrived by now."""
        return now_s - self._last_s > self._patience_s

    def comes_often(self, now_s: float) -> bool:
        """Return whether images come much faster than the first camera's rate."""
        return self._often_since_s is not None and now_s - self._often_since_s > SOURCES.stale_s

    def note(self, now_s: float, gone: bool = False, uneven: bool = False) -> str:
        """Return a description of the fault, or "" if there is none.

        Args:
            uneven: Not all cameras deliver too often; if all do, the driver has reported a wrong rate.
        """
        if self.is_silent(now_s):
            return f"{self._title} is gone, check its cable" if gone else f"{self._title} froze"
        if self._is_resized:
            return f"{self._title} gives images of another size, close other programs that use it"
        if uneven and self.comes_often(now_s):
            return f"{self._title} gives images too often, set all cameras to one rate"
        if self._black_since_s is not None and now_s - self._black_since_s > SOURCES.stale_s:
            return f"{self._title} is black, check its lens cap and the lamp"
        if self._repeats_since_s is not None and now_s - self._repeats_since_s > SOURCES.stale_s:
            return f"{self._title} repeats one image"
        if self._tears.are_many(now_s):
            return f"{self._title} gives torn images, choose a lower rate or size, or another USB port"
        return ""


class _TearWatch:
    """Watch for images whose lower part is from the previous image.

    A sensor's noise makes rows differ from the previous image's, so identical rows reveal such an image; but not if the
    tear stays at one height, because the lower part is then always one image late.
    """

    def __init__(self) -> None:
        self._fresh_images = np.zeros(0, dtype=int)  # for each row, number of images in which it was new
        self._same_rows: Mask = np.zeros(0, dtype=bool)
        self._times_s: deque[float] = deque(maxlen=SOURCES.tears)

    def update(self, time_s: float, same_rows: Mask) -> None:
        """Process the next image's mask (N,) of rows that equal the previous image's."""
        if len(same_rows) != len(self._fresh_images):
            self._fresh_images, self._same_rows = np.zeros(len(same_rows), dtype=int), same_rows
        if same_rows.all():
            return  # a repeated image is not torn
        torn = same_rows & ~self._same_rows & (self._fresh_images >= SOURCES.fresh_images)
        is_torn = any(stop - start >= SOURCES.torn_rows for start, stop in runs(torn))
        if is_torn:
            self._times_s.append(time_s)
        self._fresh_images[~same_rows] += 1
        self._fresh_images[same_rows & ~(torn & is_torn)] = 0
        self._same_rows = same_rows

    def are_many(self, now_s: float) -> bool:
        """Return whether several of the latest images were torn."""
        return len(self._times_s) == SOURCES.tears and now_s - self._times_s[0] < SOURCES.tears_s


def is_repeated(last: Image, image: Image) -> bool:
    """Return whether an image equals the previous one."""
    return bool(_same_rows(last, image).all()) and np.array_equal(last, image)


def _same_rows(last: Image | None, image: Image) -> Mask:
    """Return a mask (N,) of the compared rows that equal the previous image's."""
    rows = image[:: SOURCES.compared_rows]
    if last is None or last.shape != image.shape:
        return np.zeros(len(rows), dtype=bool)
    return np.all(last[:: SOURCES.compared_rows] == rows, axis=tuple(range(1, image.ndim)))


def _since(start_s: float | None, now_s: float, holds: bool) -> float | None:
    """Return the time from which a condition has held, or None if it does not hold now."""
    return (now_s if start_s is None else start_s) if holds else None
