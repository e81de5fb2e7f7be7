"""Images of all cameras at one moment."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Image


@dataclass(frozen=True)
class ImageSet:
    """One image per camera.

    Args:
        times_s: when each image was taken, seconds.
        images: per camera (height, width, 3) uint8 BGR.
        usable: per camera whether its image shows this moment; empty: all do. An image that does not is black.
    """

    number: int
    times_s: tuple[float, ...]
    images: tuple[Image, ...]
    notes: tuple[str, ...] = ()
    usable: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        if len(self.times_s) != len(self.images) or not self.images:
            raise CaptureError(
                f"{len(self.images)} images with {len(self.times_s)} times", where=f"frame {self.number}"
            )
        for image in self.images:
            if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
                raise CaptureError(
                    f"an image has {image.dtype} values of shape {image.shape}, not 8-bit colour",
                    where=f"frame {self.number}",
                )


class ClosableSource:
    """Base of the sources that iterate until `close`."""

    _closed = False

    def close(self) -> None:
        """Let the iteration end."""
        self._closed = True


def usable_images(images: Any) -> tuple[bool, ...]:
    """Return per camera whether its image shows the moment of an image set."""
    return tuple(getattr(images, "usable", ())) or (True,) * len(images.images)


def moment_of(images: Any) -> float | None:
    """Return the mean time of an image set, seconds; None without any image."""
    times_s = [time_s for time_s in images.times_s if np.isfinite(time_s)]
    return float(np.mean(times_s)) if times_s else None


def camera_title(index: int, names: Sequence[str]) -> str:
    """Return a camera's name in messages: left and right where there are two."""
    return f"the {('left', 'right')[index]} camera" if len(names) == 2 else f"camera {names[index]}"


def next_number(number: int, passed_s: float, period_s: float) -> int:
    """Return the frame number `passed_s` after `number`, lost frames counted.

    Only a gap of more than one and a half periods counts: cameras are late by less now and then.
    """
    return number + (round(passed_s / period_s) if passed_s > 1.5 * period_s else 1)
