"""Images of all cameras at one moment."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...errors import CaptureError, counted
from ...geometry.arrays import Image


@dataclass(frozen=True)
class ImageSet:
    """One image per camera."""

    number: int
    times_s: tuple[float, ...]  # time of each image
    images: tuple[Image, ...]  # (height, width, 3) uint8 BGR; an image that does not show this moment is black
    notes: tuple[str, ...] = ()
    usable: tuple[bool, ...] = ()  # which images show this moment; all by default

    def __post_init__(self) -> None:
        if len(self.times_s) != len(self.images) or not self.images:
            raise CaptureError(
                f"has {counted(len(self.images), 'image')}, but {counted(len(self.times_s), 'time stamp')}",
                where=f"frame {self.number}",
                advice="give one time stamp per image",
            )
        for image in self.images:
            if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
                raise CaptureError(
                    f"an image has {image.dtype} values of shape {image.shape}, not 8-bit colour",
                    where=f"frame {self.number}",
                    advice="convert it to BGR, uint8",
                )
        object.__setattr__(self, "usable", self.usable or (True,) * len(self.images))

    @property
    def mean_time_s(self) -> float | None:
        """Mean time of the images; None if no image has one."""
        times_s = [time_s for time_s in self.times_s if np.isfinite(time_s)]
        return float(np.mean(times_s)) if times_s else None


class ImageSource(Protocol):
    """Interface of everything that yields image sets."""

    fps: float

    def __iter__(self) -> Iterator[ImageSet]:
        """Yield image sets in order."""

    def close(self) -> None:
        """End the iteration and release devices."""


class SampledSource(ImageSource, Protocol):
    """Source that can give samples before the iteration: files, or cameras, which take extra images for this."""

    def samples(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield the images of up to `count` moments."""


class ClosableSource:
    """Base class of the sources that iterate until `close`."""

    _closed = False

    def close(self) -> None:
        """End the iteration."""
        self._closed = True


def camera_title(index: int, names: Sequence[str]) -> str:
    """Return a camera's name for messages: left or right if there are two."""
    return f"the {('left', 'right')[index]} camera" if len(names) == 2 else f"camera {names[index]}"


def next_number(number: int, passed_s: float, period_s: float) -> int:
    """Return the frame number `passed_s` after `number`, counting lost frames.

    Only a gap of more than one and a half periods counts, because cameras are sometimes late by less.
    """
    return number + (round(passed_s / period_s) if passed_s > 1.5 * period_s else 1)
