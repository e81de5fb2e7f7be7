"""Cameras by device number, or by address on a network, as a source."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from typing import Any

import cv2
import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Image
from .addresses import camera_name
from .camera_controls import apply_controls
from .device_names import device_numbers
from .image_files import open_address
from .image_set import ClosableSource, ImageSet
from .pairing import ImagePairing
from .source_requests import CameraControls

_WARM_UP_READS = 5
_HELD = 12  # images that wait for who takes them; then the oldest are lost
_LOOK_S = 0.02  # a camera that gives nothing wakes nobody
_RETRY_S = 0.01
_GONE_S = 0.1  # of failed reads, then the device is opened again
_REOPEN_S = 0.5
_ALL_LOST_S = 10.0
_NEVER_USABLE_S = 5.0
_JOIN_S = 0.5
_SAME_CLOCK_S = 1.0
_STREAM_OPENS_MS = 5000
_STREAM_STALLS_MS = 1000  # then its connection may be gone: another is made


class CameraSource(ClosableSource):
    """Image sets from cameras, as they come.

    Each camera is read by a thread of its own, so that one that freezes holds up no other. Images are stamped by the
    driver where its clock is ours, else when they come. Frames are numbered by these times, so that a number left out
    is a frame that was lost. A camera that freezes, is gone, black or repeats its image is named in the sets' notes and
    skipped until it is back; a lost one is opened again twice a second, so is one on a network that gave nothing for a
    second.

    Args:
        devices: device numbers or addresses, one per camera.
        size: (width, height) asked for, or None for the camera's default.
        fps: rate asked for; that of cameras on a network, which may tell a wrong one.

    Attributes:
        warnings: what a camera did not take.

    Raises:
        CaptureError: a camera does not open or gives no image; when iterated: for 10 s no camera gave any.
    """

    def __init__(
        self,
        devices: Sequence[int | str],
        size: tuple[int, int] | None = None,
        fps: float | None = None,
        controls: Sequence[CameraControls] = (),
    ) -> None:
        if len(set(devices)) != len(devices):
            raise CaptureError(
                f"camera {camera_name(devices[0])} is chosen more than once",
                advice="choose a different device for each camera",
            )
        self.name = "capture"
        self.frames = 0  # unknown: until it is closed
        self._names = [camera_name(device) for device in devices]
        self._news = threading.Event()
        self._readers: list[_Reader] = []
        try:
            for device, wanted in zip_longest(devices, controls[: len(devices)]):
                self._readers.append(_Reader(partial(_open, device, size, fps), self._news, wanted))
        except CaptureError:
            self.close()
            raise
        self.warnings: tuple[str, ...] = tuple(
            f"camera {name} does not take {' and '.join(reader.refused)}: set it by its maker's program"
            for name, reader in zip(self._names, self._readers, strict=True)
            if reader.refused
        )
        self._are_streams = [isinstance(device, str) for device in devices]
        rate = fps if fps is not None and self._are_streams[0] else self._readers[0].fps
        self.fps = rate if 1.0 <= rate <= 1000.0 else (fps or 30.0)

    def __iter__(self) -> Iterator[ImageSet]:
        """Yield image sets until `close`."""
        start_s = last_s = time.perf_counter()
        shapes = [reader.shape for reader in self._readers]
        pairing = ImagePairing(shapes, self._names, 1.0 / self.fps, 0.0, self._are_streams)
        for reader in self._readers:
            reader.begin()
        while not self._closed:
            self._news.wait(_LOOK_S)
            self._news.clear()
            for camera, reader in enumerate(self._readers):
                for time_s, image in reader.drain():
                    pairing.put(camera, time_s - start_s, image)
                    last_s = max(last_s, time_s)
            now_s = time.perf_counter()
            gone = [reader.gone for reader in self._readers]
            while not self._closed and (taken := pairing.take(now_s - start_s, gone)) is not None:
                yield taken
            if now_s - last_s > _ALL_LOST_S:
                raise CaptureError("no camera gives images any more", advice="check their cables, then start again")

    def samples(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield the images of the next `count` image sets that are complete.

        Raises:
            CaptureError: for 5 s a camera gave no usable image.
        """
        last_s = 0.0
        for image_set in self:
            moment_s = max(image_set.times_s)
            if all(image_set.usable):
                yield image_set.images
                count, last_s = count - 1, moment_s
                if count <= 0:
                    return
            elif moment_s - last_s > _NEVER_USABLE_S:
                raise CaptureError("; ".join(image_set.notes) or "a camera gives no usable images")

    def close(self) -> None:
        """End the iteration and give the cameras back."""
        super().close()
        for reader in self._readers:
            reader.stop()


class _Reader:
    """Reader of one camera in a thread, from `begin` to `stop`; reopens a lost one."""

    def __init__(self, opened: Callable[[], Any], news: threading.Event, controls: CameraControls | None) -> None:
        self.gone = False
        self.refused: Sequence[str] = ()
        self._opened = opened
        self._controls = controls
        self._news = news
        self._images: deque[tuple[float, Image]] = deque(maxlen=_HELD)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        first = self._open()
        self.shape = first.shape
        self.fps = float(self._capture.get(cv2.CAP_PROP_FPS))

    def _open(self) -> Image:
        self._capture, image = self._opened()
        if self._controls is not None:
            self.refused = apply_controls(self._capture, self._controls)
        return np.asarray(image)

    def begin(self) -> None:
        """Start reading; earlier images are forgotten."""
        self._images.clear()
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
            self._thread.start()

    def drain(self) -> Iterator[tuple[float, Image]]:
        """Yield the images so far, oldest first, with their times."""
        while self._images:
            yield self._images.popleft()

    def stop(self) -> None:
        """Give the camera back; one that hangs is given back when it answers."""
        self._stop.set()
        if self._thread is None:
            self._release()
        else:
            self._thread.join(_JOIN_S)

    def _run(self) -> None:
        failing_since_s: float | None = None
        while not self._stop.is_set():
            if self._capture is None:
                self._reopen()
                continue
            if self._read():
                failing_since_s, self.gone = None, False
                self._news.set()
                continue
            now_s = time.perf_counter()
            failing_since_s = now_s if failing_since_s is None else failing_since_s
            if now_s - failing_since_s > _GONE_S:
                failing_since_s, self.gone = None, True
                self._release()
            self._stop.wait(_RETRY_S)
        self._release()

    def _read(self) -> bool:
        if not self._capture.grab():
            return False
        now_s = time.perf_counter()
        stamp_s = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0  # some drivers' stamps are of this clock
        ok, image = self._capture.retrieve()
        if not ok:
            return False
        self._images.append((stamp_s if 0.0 <= now_s - stamp_s < _SAME_CLOCK_S else now_s, np.asarray(image, np.uint8)))
        return True

    def _reopen(self) -> None:
        try:
            self._open()
        except CaptureError:
            self._stop.wait(_REOPEN_S)

    def _release(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None


def _open(device: int | str, size: tuple[int, int] | None, fps: float | None) -> tuple[Any, Image]:
    """Return an open camera and an image of it."""
    if isinstance(device, str):
        capture = open_address(device, _STREAM_OPENS_MS, _STREAM_STALLS_MS)
        advice = "check the address, also in a web browser or player, and that the camera is switched on"
    else:
        capture = cv2.VideoCapture(device)
        advice = "check that it is plugged in, that no other program uses it and that this one may use cameras"
    if not capture.isOpened():
        capture.release()
        raise CaptureError(f"camera {camera_name(device)} does not open", advice=advice)
    if size is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    if fps is not None:
        capture.set(cv2.CAP_PROP_FPS, fps)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    for _ in range(_WARM_UP_READS):
        ok, image = capture.read()
        if ok:
            return capture, np.asarray(image, dtype=np.uint8)
    capture.release()
    raise CaptureError(
        f"camera {camera_name(device)} gives no image", advice="unplug it, plug it in again, close other programs"
    )


@dataclass(frozen=True)
class FoundCamera:
    """A camera of this computer.

    Args:
        size: (width, height) of its images in pixels, None when it gives none.
        image: one of them.
    """

    device: int
    size: tuple[int, int] | None
    image: Image | None = field(default=None, compare=False, repr=False)


def find_cameras() -> list[FoundCamera]:
    """Return the plugged-in cameras, also silent ones; each is opened for a moment."""
    found = []
    for device in device_numbers():
        capture = cv2.VideoCapture(device)
        if capture.isOpened():
            images = (capture.read() for _ in range(_WARM_UP_READS))
            image = next((image for ok, image in images if ok), None)
            size = None if image is None else (image.shape[1], image.shape[0])
            found.append(FoundCamera(device, size, None if image is None else np.asarray(image, dtype=np.uint8)))
        capture.release()
    return found
