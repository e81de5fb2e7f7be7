"""Health of one camera, by the times and content of its images."""

import numpy as np

from ...geometry.arrays import Image

# Reported within a quarter of a second; the rest of it is for the way to the panel.
_SILENT_S = 0.12
_SILENT_PERIODS = 2.5  # slow cameras are silent between two images
_STALE_S = 0.1
_TOO_OFTEN = 0.6  # periods between images of a camera that runs at another rate
_BLACK_LEVEL = 24  # grey levels: above the noise of a covered sensor
_CONTRAST = 2  # what has been so many times brighter than black can become black
_COMPARED_ROWS = 16


class CameraHealth:
    """Health of a camera: frozen, unplugged, black, changed, or repeating an image."""

    def __init__(self, title: str, period_s: float, now_s: float, shape: tuple[int, ...]) -> None:
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

    def update(self, time_s: float, image: Image) -> bool:
        """Take the next image; return whether it shows something new."""
        too_often = 0.0 <= time_s - self._last_s < _TOO_OFTEN * self._period_s
        self._often_since_s = _since(self._often_since_s, time_s, too_often)
        self._last_s, self._is_resized = time_s, image.shape != self._shape
        repeated = self._last is not None and is_repeated(self._last, image)
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
        return ""


def is_repeated(last: Image, image: Image) -> bool:
    """Return whether an image is exactly the one before it."""
    if last.shape != image.shape or not np.array_equal(last[::_COMPARED_ROWS], image[::_COMPARED_ROWS]):
        return False
    return np.array_equal(last, image)


def _since(start_s: float | None, now_s: float, holds: bool) -> float | None:
    """Return since when something holds that held since `start_s`."""
    if not holds:
        return None
    return now_s if start_s is None else start_s
