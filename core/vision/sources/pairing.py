"""Images of cameras that run by themselves, put together to image sets."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from ...geometry.arrays import Image
from ...system.steady_clock import SteadyClock
from .camera_watch import CameraHealth
from .image_set import ImageSet, camera_title, next_number

_TOGETHER = 0.75  # periods: images further apart in time are of two moments
_LATE = 0.25  # periods: an image so little after a set that went without it comes too late
_PATIENCE = 2.0  # periods for which the other cameras' image is waited for
_HELD = 12  # images of a camera; who takes them too slowly loses the oldest


class ImagePairing:
    """Grouping of images by their times; a silent camera is skipped.

    A camera with a missing, repeated or black image has a black image in the set and is marked as not usable.

    Args:
        now_s: time on the clock that the images' times are read from.
        compressed: per camera whether its images come compressed; empty: none.
    """

    def __init__(
        self,
        shapes: Sequence[tuple[int, ...]],
        names: Sequence[str],
        period_s: float,
        now_s: float,
        compressed: Sequence[bool] = (),
    ) -> None:
        self._black = [np.zeros(shape, dtype=np.uint8) for shape in shapes]
        self._period_s = period_s
        self._held: list[deque[tuple[float, Image, bool]]] = [deque(maxlen=_HELD) for _ in shapes]
        self._watches = [
            CameraHealth(camera_title(i, names), period_s, now_s, shape, is_compressed)
            for i, (shape, is_compressed) in enumerate(zip(shapes, compressed or [False] * len(shapes), strict=True))
        ]
        self._clocks = [SteadyClock() for _ in shapes]
        self._number = -1
        self._last_s = -np.inf

    def put(self, camera: int, time_s: float, image: Image) -> None:
        """Take an image that a camera gave."""
        fresh = self._watches[camera].update(time_s, image)
        time_s = self._clocks[camera].steady(time_s)
        if time_s < self._last_s + _LATE * self._period_s:
            return
        self._held[camera].append((time_s, image, fresh))

    def take(self, now_s: float, gone: Sequence[bool] = ()) -> ImageSet | None:
        """Return the next image set, None while there is nothing new.

        Args:
            gone: per camera whether its device said that it cannot give images.
        """
        first = [held[0][0] for held in self._held if held]
        if not first:
            return None
        start_s = min(first)
        waits = any(
            not held and not watch.is_silent(now_s) for held, watch in zip(self._held, self._watches, strict=True)
        )
        if waits and now_s - start_s < _PATIENCE * self._period_s:
            return None
        before_s = start_s + _TOGETHER * self._period_s
        rows = [held.popleft() if held and held[0][0] < before_s else None for held in self._held]
        known = [row for row in rows if row is not None]
        middle_s = float(np.mean([time_s for time_s, _, _ in known]))
        self._number = next_number(self._number, start_s - self._last_s, self._period_s) if self._number >= 0 else 0
        self._last_s = start_s
        lost = tuple(gone) or (False,) * len(self._watches)
        uneven = not all(watch.comes_often(now_s) for watch in self._watches)
        notes = [watch.note(now_s, away, uneven) for watch, away in zip(self._watches, lost, strict=True)]
        return ImageSet(
            number=self._number,
            times_s=tuple(middle_s if row is None else row[0] for row in rows),
            images=tuple(
                row[1] if row is not None and row[2] else black for row, black in zip(rows, self._black, strict=True)
            ),
            notes=tuple(note for note in notes if note),
            usable=tuple(row is not None and row[2] for row in rows),
        )
