"""Cameras by device number as a source."""

import time
from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np

from ..errors import CaptureError
from .image_set import Image, ImageSet, next_number

_WARM_UP_READS = 5
_LOST_AFTER = 10


class CameraSource:
    """Image sets from cameras, as they come.

    All cameras are told to take an image (`grab`) before any is decoded, so that they differ by little time. Frames are
    numbered by the time at which they come, so that a number left out is a frame that was lost.

    Args:
        devices: device numbers (or stream addresses), one per camera.
        size: (width, height) asked for, or None for the camera's default.
        fps: rate asked for.

    Raises:
        CaptureError: a camera does not open or gives no image; when iterated: it stopped giving images.
    """

    def __init__(
        self, devices: Sequence[int | str], size: tuple[int, int] | None = None, fps: float | None = None
    ) -> None:
        if len(set(devices)) != len(devices):
            raise CaptureError(
                f"camera {devices[0]} is chosen more than once", advice="choose a different device for each camera"
            )
        self.name = "capture"
        self.warnings: tuple[str, ...] = ()
        self.frames = 0  # unknown: until it is closed
        self._devices = list(devices)
        self._captures: list[Any] = []
        self._closed = False
        try:
            for device in devices:
                self._captures.append(_open(device, size, fps))
        except CaptureError:
            self.close()
            raise
        rate = float(self._captures[0].get(cv2.CAP_PROP_FPS))
        self.fps = rate if 1.0 <= rate <= 1000.0 else (fps or 30.0)

    @property
    def cameras(self) -> int:
        """Images per set."""
        return len(self._devices)

    def __iter__(self) -> Iterator[ImageSet]:
        """Yield image sets until `close`."""
        start = time.perf_counter()
        number, last_s, failures = -1, 0.0, 0
        while not self._closed:
            taken = self._take(start)
            if taken is None:
                failures += 1
                if failures >= _LOST_AFTER:
                    raise CaptureError("a camera stopped giving images", advice="check its cable, then start again")
                continue
            failures = 0
            times_s, images = taken
            number = next_number(number, times_s[0] - last_s, 1.0 / self.fps) if number >= 0 else 0
            last_s = times_s[0]
            yield ImageSet(number, times_s, images)

    def _take(self, start: float) -> tuple[tuple[float, ...], tuple[Image, ...]] | None:
        times_s = []
        for capture in self._captures:
            if not capture.grab():
                return None
            times_s.append(time.perf_counter() - start)
        results = [capture.retrieve() for capture in self._captures]
        if not all(ok for ok, _ in results):
            return None
        return tuple(times_s), tuple(np.asarray(image, dtype=np.uint8) for _, image in results)

    def samples(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield the next `count` image sets' images."""
        for _, image_set in zip(range(count), self, strict=False):
            yield image_set.images

    def close(self) -> None:
        """End the iteration and give the cameras back."""
        self._closed = True
        for capture in self._captures:
            capture.release()
        self._captures = []


def _open(device: int | str, size: tuple[int, int] | None, fps: float | None) -> Any:
    capture = cv2.VideoCapture(device)
    if not capture.isOpened():
        capture.release()
        raise CaptureError(
            f"camera {device} does not open",
            advice="check that it is plugged in, that no other program uses it and that this one may use cameras",
        )
    if size is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    if fps is not None:
        capture.set(cv2.CAP_PROP_FPS, fps)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    for _ in range(_WARM_UP_READS):
        ok, _ = capture.read()
        if ok:
            return capture
    capture.release()
    raise CaptureError(f"camera {device} gives no image", advice="unplug it, plug it in again, close other programs")
