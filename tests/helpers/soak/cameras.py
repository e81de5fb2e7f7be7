"""Let one of two cameras fail in many ways; measure report and recovery.

Two drivers of this file give images of 60 Hz with the noise of a sensor; the source reads them as it reads real ones.
A camera on a network is a server on this computer, which OpenCV reads.
At a random moment the right one begins, for a second and a half, to

- stall: give nothing and not return,
- taken: fail, and not open again: another program has it,
- slow: give one image a second,
- fast: give 240 images a second,
- size: give images of another size,
- backward: stamp its images half a second back,
- torn: give images with the last one's lower part, from some height on,
- stream, cut: as a camera on a network, give nothing, the connection left or ended.

For each fault: seconds until a note names the right camera, seconds from the fault's end to a set of images of both
without a note, and the share of the left camera's images that were used meanwhile. A row is wrong where a fault is
reported later than 0.25 s, recovered later than 1 s, or where fewer than 95 % of the left camera's images are used.
"""

import random
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from mjpeg_server import MjpegServer
from perfanim.core.errors import CaptureError
from perfanim.core.geometry.arrays import Image
from perfanim.core.vision.sources import camera_source

from .processes import Row

FAULTS = ("stall", "taken", "slow", "fast", "size", "backward", "torn", "stream", "cut")
FPS = 60.0
BEFORE_S, FAILS_S, AFTER_S = 1.5, 1.5, 2.0
MOST_REPORTED_S, MOST_RECOVERED_S, LEAST_USED = 0.25, 1.0, 0.95
BACK_S = 0.5
PATIENCE_S = 0.5  # beyond AFTER_S


class Driver:
    """A camera at FPS; `fault` is its present one, "" for none."""

    def __init__(self, seed: int) -> None:
        self.fault = ""
        self.given: list[float] = []  # when each image was
        self._mended = threading.Event()
        noise, self._chance = np.random.default_rng(seed), random.Random(seed)  # noqa: S311 - heights, no secrets
        self.images = [self._picture(noise, 640, 480) for _ in range(7)]
        self._others = [self._picture(noise, 320, 240) for _ in range(7)]
        self._due_s = self._stamp_s = time.perf_counter()

    @staticmethod
    def _picture(noise: np.random.Generator, width: int, height: int) -> Image:
        image = noise.integers(0, 12, (height, width, 3), dtype=np.uint8)
        image[100:110, 100:110] = 220
        return image

    def begin(self, fault: str) -> None:
        """Begin a fault."""
        self._mended.clear()
        self.fault = fault

    def mend(self) -> None:
        """End the fault."""
        self.fault = ""
        self._mended.set()

    def open(self) -> tuple["Driver", Image]:
        """Return this driver and an image, as the source opens one."""
        if self.fault == "taken":
            raise CaptureError("does not open")
        return self, self.images[0]

    def grab(self) -> bool:
        """Wait for the next image."""
        if self.fault == "taken":
            return False
        if self.fault == "stall":
            self._mended.wait()
        period_s = {"slow": 1.0, "fast": 1.0 / 240.0}.get(self.fault, 1.0 / FPS)
        self._due_s = max(self._due_s + period_s, time.perf_counter() - period_s)
        if self.fault == "slow":
            self._mended.wait(max(self._due_s - time.perf_counter(), 0.0))
        else:
            time.sleep(max(self._due_s - time.perf_counter(), 0.0))
        self._stamp_s = time.perf_counter()
        return True

    def retrieve(self) -> tuple[bool, Image]:
        """Return the image."""
        self.given.append(time.perf_counter())
        at = len(self.given) % len(self.images)
        if self.fault == "size":
            return True, self._others[at]
        if self.fault == "torn":
            edge = self._chance.randrange(480)
            return True, np.concatenate((self.images[at][:edge], self.images[at - 1][edge:]))
        return True, self.images[at]

    def get(self, key: int) -> float:
        """Return the rate, or the stamp of the image in milliseconds."""
        if key == cv2.CAP_PROP_POS_MSEC:
            return 1000.0 * (self._stamp_s - BACK_S * (self.fault == "backward"))
        return FPS if key == cv2.CAP_PROP_FPS else 0.0

    def release(self) -> None:
        """Give nothing back: the source may open it again."""


def failed(fault: str, chance: random.Random) -> dict[str, Any]:
    """Return the figures of one fault."""
    drivers = [Driver(chance.randrange(1 << 30)) for _ in range(2)]
    if fault not in ("stream", "cut"):
        return _measured(fault, chance, drivers, 1, drivers[1])
    with MjpegServer(drivers[1].images, FPS) as server:
        return _measured(fault, chance, drivers, server.address, server)


def _measured(
    fault: str, chance: random.Random, drivers: Sequence[Driver], right: int | str, failing: Driver | MjpegServer
) -> dict[str, Any]:
    """Return the figures of one fault of the right camera."""
    really_open = camera_source._open

    def opened(device: int | str, *asked: Any) -> tuple[Any, Image]:
        return really_open(device, *asked) if isinstance(device, str) else drivers[device].open()

    begin_s = time.perf_counter() + BEFORE_S + chance.uniform(0.0, 0.1)
    end_s = begin_s + FAILS_S
    reported_s = recovered_s = float("inf")
    note, used = "", 0
    with patch.object(camera_source, "_open", opened):
        source = camera_source.CameraSource([0, right], fps=FPS)
        timers = [
            threading.Timer(begin_s - time.perf_counter(), failing.begin, [fault]),
            threading.Timer(end_s - time.perf_counter(), failing.mend),
        ]
        for timer in timers:
            timer.start()
        try:
            for image_set in source:
                now_s = time.perf_counter()
                if now_s >= begin_s and image_set.notes and not note:
                    reported_s, note = now_s - begin_s, image_set.notes[0]
                used += bool(image_set.usable[0] and begin_s <= now_s < end_s)
                if now_s >= end_s and all(image_set.usable) and not image_set.notes:
                    recovered_s = min(recovered_s, now_s - end_s)
                if now_s > end_s + (0.0 if note and recovered_s < AFTER_S else AFTER_S):
                    break
        finally:
            failing.mend()
            source.close()
            for timer in timers:
                timer.join()
    given = sum(begin_s <= moment_s < end_s for moment_s in drivers[0].given)
    row = {"fault": fault, "reported_s": reported_s, "recovered_s": recovered_s, "used": used / given, "note": note}
    return row | {"wrong": _wrong(row)}


def _wrong(row: dict[str, Any]) -> list[str]:
    wrong = []
    if row["reported_s"] > MOST_REPORTED_S:
        wrong.append("reported late")
    if row["recovered_s"] > MOST_RECOVERED_S:
        wrong.append("recovered late")
    if row["used"] < LEAST_USED:
        wrong.append("images of the healthy camera are lost")
    return wrong


def rows(count: int, seed: int) -> Iterator[Row]:
    """Yield the rows of each fault, `count` of each."""
    chance = random.Random(seed)  # noqa: S311 - moments, no secrets
    for fault in FAULTS:
        for _ in range(count):
            yield failed(fault, chance)
