"""Image source for cameras, given by device number or network address."""

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
from ...system.files import exists
from .addresses import camera_name
from .camera_controls import apply_controls
from .device_names import device_numbers
from .image_files import open_address
from .image_set import ClosableSource, ImageSet
from .pairing import ImagePairing
from .source_requests import CameraControls
from .source_settings import SOURCES


class CameraSource(ClosableSource):
    """Image sets from cameras, as they arrive.

    A thread reads each camera, so that a frozen one does not delay the others. Images are stamped by the driver if it
    uses this computer's clock, else on arrival. Frames are numbered by these times; a missing number is a lost frame. A
    camera that freezes, disconnects, turns black or repeats its image is named in the image sets' notes and skipped
    until it recovers. A disconnected camera is reopened twice a second, and so is a network camera that has been silent
    for a second.

    Args:
        devices: Device number or address of each camera.
        size: Requested width and height of the images; None for the camera's default.
        fps: Requested rate; network cameras are assumed to have it.
        held: Largest number of images of a camera that wait while earlier ones are processed; 1 keeps the newest.

    Attributes:
        warnings: Controls that a camera refused.

    Raises:
        CaptureError: A camera does not open or gives no image; during iteration, no camera has given any for 10 s.
    """

    def __init__(
        self,
        devices: Sequence[int | str],
        size: tuple[int, int] | None = None,
        fps: float | None = None,
        controls: Sequence[CameraControls] = (),
        held: int = SOURCES.held,
    ) -> None:
        twice = next((device for at, device in enumerate(devices) if device in devices[:at]), None)
        if twice is not None:
            raise CaptureError(
                f"camera {camera_name(twice)} is chosen more than once",
                advice="choose a different device for each camera",
            )
        self.name = "capture"
        self.frames = 0  # unknown
        self._names = [camera_name(device) for device in devices]
        self._news = threading.Event()
        self._readers: list[_Reader] = []
        try:
            for device, wanted in zip_longest(devices, controls[: len(devices)]):
                self._readers.append(_Reader(partial(_open, device, size, fps), self._news, wanted, held))
        except CaptureError:
            self.close()
            raise
        self.warnings: tuple[str, ...] = tuple(
            f"camera {name} does not accept {' and '.join(reader.refused)}: use the manufacturer's program instead"
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
            self._news.wait(SOURCES.poll_s)
            self._news.clear()
            for camera, reader in enumerate(self._readers):
                for time_s, image in reader.drain():
                    pairing.put(camera, time_s - start_s, image)
                    last_s = max(last_s, time_s)
            now_s = time.perf_counter()
            gone = [reader.gone for reader in self._readers]
            while not self._closed and (taken := pairing.take(now_s - start_s, gone)) is not None:
                yield taken
            if now_s - last_s > SOURCES.all_lost_s:
                raise CaptureError(
                    "no camera gives images any more", advice="check the cameras' cables, then start again"
                )

    def samples(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield the images of the next `count` complete image sets.

        Raises:
            CaptureError: A camera has given no usable image for 5 s.
        """
        last_s = 0.0
        for image_set in self:
            moment_s = max(image_set.times_s)
            if all(image_set.usable):
                yield image_set.images
                count, last_s = count - 1, moment_s
                if count <= 0:
                    return
            elif moment_s - last_s > SOURCES.never_usable_s:
                raise CaptureError(
                    "; ".join(image_set.notes) or "a camera gives no usable images",
                    advice="check the cameras and their cables",
                )

    def close(self) -> None:
        """End the iteration and release the cameras."""
        super().close()
        for reader in self._readers:
            reader.stop()


class _Reader:
    """Reader of one camera in a thread, from `begin` to `stop`; a camera that is lost is reopened."""

    def __init__(
        self, opened: Callable[[], Any], news: threading.Event, controls: CameraControls | None, held: int
    ) -> None:
        self.gone = False
        self.refused: Sequence[str] = ()
        self._opened = opened
        self._controls = controls
        self._news = news
        self._images: deque[tuple[float, Image]] = deque(maxlen=held)
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
        """Start reading; earlier images are dropped."""
        self._images.clear()
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
            self._thread.start()

    def drain(self) -> Iterator[tuple[float, Image]]:
        """Yield the times and images that have arrived, oldest first."""
        while self._images:
            yield self._images.popleft()

    def stop(self) -> None:
        """Release the camera; a hung camera is released once it responds."""
        self._stop.set()
        if self._thread is None:
            self._release()
        else:
            self._thread.join(SOURCES.join_s)

    def _run(self) -> None:
        failing_since_s: float | None = None
        while not self._stop.is_set():
            if self._capture is None:
                try:
                    self._open()
                except CaptureError:
                    self._stop.wait(SOURCES.reopen_s)
                continue
            if self._read():
                failing_since_s, self.gone = None, False
                self._news.set()
                continue
            now_s = time.perf_counter()
            failing_since_s = now_s if failing_since_s is None else failing_since_s
            if now_s - failing_since_s > SOURCES.gone_s:
                failing_since_s, self.gone = None, True
                self._release()
            self._stop.wait(SOURCES.retry_s)
        self._release()

    def _read(self) -> bool:
        if not self._capture.grab():
            return False
        now_s = time.perf_counter()
        stamp_s = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0  # some drivers use this clock
        ok, image = self._capture.retrieve()
        if not ok:
            return False
        is_ours = 0.0 <= now_s - stamp_s < SOURCES.same_clock_s
        self._images.append((stamp_s if is_ours else now_s, np.asarray(image, np.uint8)))
        return True

    def _release(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None


def _open(device: int | str, size: tuple[int, int] | None, fps: float | None) -> tuple[Any, Image]:
    """Return an open camera and its first image."""
    if isinstance(device, str):
        capture = open_address(device, SOURCES.stream_opens_ms, SOURCES.stream_stalls_ms)
        advice = "check that the camera is switched on, and try the address in a web browser or video player"
    else:
        capture = cv2.VideoCapture(device)
        advice = "check that it is plugged in, that no other program uses it and that this program may use cameras"
        if exists(str(device)):
            advice = f"write ./{device} for the file or folder of this name"
    if not capture.isOpened():
        capture.release()
        raise CaptureError(f"camera {camera_name(device)} does not open", advice=advice)
    if size is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    if fps is not None:
        capture.set(cv2.CAP_PROP_FPS, fps)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    first = _first_image(capture)
    if first is not None:
        return capture, first
    capture.release()
    raise CaptureError(
        f"camera {camera_name(device)} gives no image", advice="unplug it and plug it in again, or close other programs"
    )


def _first_image(capture: Any) -> Image | None:
    reads = (capture.read() for _ in range(SOURCES.warm_up_reads))
    return next((np.asarray(image, dtype=np.uint8) for ok, image in reads if ok), None)


@dataclass(frozen=True)
class FoundCamera:
    """A camera on this computer; if it gives no image, its size (width, height) is unknown, too."""

    device: int
    size: tuple[int, int] | None
    image: Image | None = field(default=None, compare=False, repr=False)


def find_cameras() -> list[FoundCamera]:
    """Return the plugged-in cameras, including those without images; each is opened for a moment."""
    found = []
    for device in device_numbers():
        capture = cv2.VideoCapture(device)
        if capture.isOpened():
            image = _first_image(capture)
            found.append(FoundCamera(device, None if image is None else (image.shape[1], image.shape[0]), image))
        capture.release()
    return found
