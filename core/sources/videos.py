"""Video files and streams as a source."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..errors import CaptureError
from .image_set import Image, ImageSet, next_number

_STREAM_PREFIXES = ("http://", "https://", "rtsp://", "rtmp://", "udp://", "tcp://")


def is_stream(address: str) -> bool:
    """Return whether an address is a network stream."""
    return address.lower().startswith(_STREAM_PREFIXES)


class VideoSource:
    """Image sets from one video per camera, frame by frame; files can be iterated any number of times.

    Frames are numbered by the time stamps of the first video, so that a number left out is a frame that was lost.

    Args:
        paths: video files or stream addresses, one per camera.
        fps: rate to assume where a file does not tell it.

    Raises:
        CaptureError: missing or unreadable file, files of different length (also when one ends early while it
            is iterated).
    """

    def __init__(self, paths: Sequence[str | Path], fps: float = 30.0) -> None:
        self._paths = [str(path) for path in paths]
        self.warnings: tuple[str, ...] = ()
        self.name = Path(self._paths[0]).stem
        counts, rates = [], []
        for path in self._paths:
            capture = _open(path)
            counts.append(0 if is_stream(path) else int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
            rates.append(float(capture.get(cv2.CAP_PROP_FPS)))
            capture.release()
        if len(set(counts)) > 1 and min(counts) > 0:
            raise CaptureError(
                "the videos have different lengths: "
                + ", ".join(f"{Path(p).name} {n} frames" for p, n in zip(self._paths, counts, strict=True)),
                advice="cut them so that they start and end at the same moments",
            )
        self.frames = min(counts)
        self.fps = rates[0] if 1.0 <= rates[0] <= 1000.0 else fps
        self._closed = False

    @property
    def cameras(self) -> int:
        """Images per set."""
        return len(self._paths)

    def __iter__(self) -> Iterator[ImageSet]:
        """Yield all image sets in order."""
        with ExitStack() as stack:
            captures = [_open(path) for path in self._paths]
            for capture in captures:
                stack.callback(capture.release)
            number, last_s = -1, 0.0
            while not self._closed:
                images = self._read(captures, number + 1)
                if images is None:
                    return
                stamp_s = float(captures[0].get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
                number = next_number(number, stamp_s - last_s, 1.0 / self.fps) if number >= 0 else 0
                last_s = stamp_s
                yield ImageSet(number, (number / self.fps,) * len(images), images)

    def _read(self, captures: Sequence[Any], number: int) -> tuple[Image, ...] | None:
        results = [capture.read() for capture in captures]
        read = [bool(ok) for ok, _ in results]
        if all(read):
            return tuple(_bgr(image) for _, image in results)
        if any(read):
            ended = self._paths[read.index(False)]
            raise CaptureError(
                f"ends after {number} frames, before the other video", where=ended, advice="cut both to one length"
            )
        if number < self.frames - 1:  # some containers announce one frame more than they hold
            raise CaptureError(
                f"cannot be read after frame {number} of {self.frames}",
                where=self._paths[0],
                advice="the file is damaged: export it again",
            )
        return None

    def samples(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield the images of up to `count` moments spread over the files (nothing for streams)."""
        if self.frames <= 0:
            return
        wanted = {int(i) for i in np.linspace(0, self.frames - 1, count)}
        with ExitStack() as stack:
            captures = [_open(path) for path in self._paths]
            for capture in captures:
                stack.callback(capture.release)
            for index in range(max(wanted) + 1):
                # frames are stepped over, not sought: seeking is inexact in many containers
                if not all(capture.grab() for capture in captures):
                    return
                if index in wanted:
                    yield tuple(_bgr(capture.retrieve()[1]) for capture in captures)

    def close(self) -> None:
        """Let the iteration end."""
        self._closed = True


def _open(path: str) -> Any:
    if not is_stream(path) and not Path(path).is_file():
        raise CaptureError("there is no such video", where=path, advice="check the path")
    capture = cv2.VideoCapture(path)
    if not capture.isOpened():
        capture.release()
        raise CaptureError("cannot be opened as a video", where=path, advice="use MP4 (H.264) or AVI (MJPEG)")
    return capture


def _bgr(image: Any) -> Image:
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.asarray(image, dtype=np.uint8)
