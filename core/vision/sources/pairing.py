"""Grouping unsynchronised cameras' images into image sets."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from ...geometry.arrays import Image
from ...system.steady_clock import SteadyClock
from .camera_watch import CameraHealth
from .image_set import ImageSet, camera_title, next_number
from .source_settings import SOURCES


class ImagePairing:
    """Grouping of images by their times; a silent camera is skipped.

    In place of a missing, repeated or black image, the set contains a black one that is marked unusable.

    Args:
        now_s: Current time of the clock that stamps the images.
        compressed: Which cameras' images arrive compressed; none by default.
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
        self._held: list[deque[tuple[float, Image, bool]]] = [deque(maxlen=SOURCES.held) for _ in shapes]
        self._watches = [
            CameraHealth(camera_title(i, names), period_s, now_s, shape, is_compressed)
            for i, (shape, is_compressed) in enumerate(zip(shapes, compressed or [False] * len(shapes), strict=True))
        ]
        self._clocks = [SteadyClock() for _ in shapes]
        self._number = -1
        self._last_s = -np.inf

    def put(self, camera: int, time_s: float, image: Image) -> None:
        """Add an image from a camera."""
        fresh = self._watches[camera].update(time_s, image)
        time_s = self._clocks[camera].steady(time_s)
        if time_s >= self._last_s + SOURCES.late * self._period_s:
            self._held[camera].append((time_s, image, fresh))

    def take(self, now_s: float, gone: Sequence[bool] = ()) -> ImageSet | None:
        """Return the next image set, or None if it is not complete yet.

        Args:
            gone: Which devices reported that they cannot give images.
        """
        first = [held[0][0] for held in self._held if held]
        if not first:
            return None
        start_s = min(first)
        waits = any(
            not held and not watch.is_silent(now_s) for held, watch in zip(self._held, self._watches, strict=True)
        )
        if waits and now_s - start_s < SOURCES.patience * self._period_s:
            return None
        before_s = start_s + SOURCES.together * self._period_s
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
