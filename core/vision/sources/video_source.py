"""Video files as a source."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Image
from ...system.file_content import check_kind
from ...system.files import is_file, open_foreign, reading
from .addresses import is_address
from .camera_watch import is_repeated
from .image_files import open_address
from .image_header import check_image_size
from .image_set import ClosableSource, ImageSet, next_number

_CONTAINER = re.compile(
    rb"RIFF....AVI |\x1aE\xdf\xa3|....(?:ftyp|moov|mdat|wide|free|skip|pnot)|\x00\x00\x01[\xba\xb3]"
    rb"|\x30\x26\xb2\x75\x8e\x66\xcf\x11|FLV\x01|OggS|\x06\x0e\x2b\x34",
    re.DOTALL,
)  # AVI, Matroska and WebM, MP4 and MOV, MPEG, WMV, Flash, Ogg, MXF
_TRANSPORT = ((0, 188), (4, 192))  # first mark of a packet and bytes to the next, in MPEG-TS and in that of camcorders


class VideoSource(ClosableSource):
    """Image sets from one video per camera; files can be iterated any number of times.

    Frames are numbered by each video's time stamps; a missing number is a lost frame. A frame that one video lacks, or
    shows twice while another goes on, is not usable there.

    Args:
        paths: Video files or addresses of films, one per camera.
        fps: Rate where a file does not contain it.

    Attributes:
        warnings: Faults in the frames so far.

    Raises:
        CaptureError: A file is missing or unreadable, or the lengths differ (also in the iteration).
    """

    def __init__(self, paths: Sequence[str | Path], fps: float = 30.0) -> None:
        self._paths = [str(path) for path in paths]
        self.warnings: tuple[str, ...] = ()
        self.name = Path(self._paths[0]).stem
        counts, rates = [], []
        for path in self._paths:
            capture = _open(path)
            counts.append(max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0))
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

    def __iter__(self) -> Iterator[ImageSet]:
        with ExitStack() as stack:
            captures = [_open(path) for path in self._paths]
            for capture in captures:
                stack.callback(capture.release)
            readers = [_Reader(capture, self.fps) for capture in captures]
            self._advance(readers, readers)
            while not self._closed and readers[0].image is not None:
                number = min(reader.number for reader in readers)
                current = [reader for reader in readers if reader.number == number]
                repeated = [reader.is_repeated for reader in readers]
                usable = tuple(
                    # a repetition in all videos shows that nothing moved
                    reader in current and (not reader.is_repeated or all(repeated))
                    for reader in readers
                )
                for reader, use in zip(readers, usable, strict=True):
                    reader.lost += reader not in current
                    reader.doubled += reader in current and not use
                images = tuple(
                    reader.image if use else np.zeros_like(reader.image)
                    for reader, use in zip(readers, usable, strict=True)
                )
                yield ImageSet(number, (number / self.fps,) * len(images), images, usable=usable)
                self.warnings = self._warnings(readers)
                self._advance(readers, current)

    def _advance(self, readers: Sequence["_Reader"], current: Sequence["_Reader"]) -> None:
        """Read the next frame of the current videos; at the end, no reader has an image."""
        before = max(reader.number for reader in readers)
        for reader in current:
            reader.read()
        ended = [path for path, reader in zip(self._paths, readers, strict=True) if reader.image is None]
        if ended and not all(reader.ends_within(2) for reader in readers):  # the last frames may be lost in one video
            raise CaptureError(
                f"ends after {before + 1} frames, before the other video",
                where=ended[0],
                advice="cut both to one length",
            )
        if ended and before + 1 < self.frames - 1:  # some containers announce a frame too many
            raise CaptureError(
                f"cannot be read after frame {before + 1} of {self.frames}",
                where=self._paths[0],
                advice="the file is damaged: export it again",
            )

    def _warnings(self, readers: Sequence["_Reader"]) -> tuple[str, ...]:
        found = []
        for path, reader in zip(self._paths, readers, strict=True):
            if reader.doubled:
                found.append(f"{Path(path).name} shows {reader.doubled} frame(s) twice; the second were left out")
            if reader.lost:
                found.append(f"{Path(path).name} lacks {reader.lost} frame(s) that another video has")
        return tuple(found)

    def samples(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield images of up to `count` moments spread over files of known length."""
        if self.frames <= 0:
            return
        wanted = {int(i) for i in np.linspace(0, self.frames - 1, count)}
        with ExitStack() as stack:
            captures = [_open(path) for path in self._paths]
            for capture in captures:
                stack.callback(capture.release)
            for index in range(max(wanted) + 1):
                # seeking is inexact in many containers
                if not all(capture.grab() for capture in captures):
                    return
                if index in wanted:
                    yield tuple(_bgr(capture.retrieve()[1]) for capture in captures)


class _Reader:
    """Reads one video; frames are numbered by its own time stamps."""

    def __init__(self, capture: Any, fps: float) -> None:
        self.number = -1
        self.image: Any = None
        self.is_repeated = False
        self.lost = 0
        self.doubled = 0
        self._capture = capture
        self._period_s = 1.0 / fps
        self._stamp_s = 0.0

    def read(self) -> None:
        """Read the next frame; `image` is None at the end."""
        ok, image = self._capture.read()
        if not ok:
            self.image = None
            return
        image = _bgr(image)
        self.is_repeated = self.image is not None and is_repeated(self.image, image)
        stamp_s = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
        passed_s = stamp_s - self._stamp_s
        self.number = next_number(self.number, passed_s, self._period_s) if self.number >= 0 else 0
        self.image, self._stamp_s = image, stamp_s

    def ends_within(self, frames: int) -> bool:
        """Read on; return whether the video ended within so many frames."""
        for _ in range(frames):
            if self.image is not None:
                self.read()
        return self.image is None


def _open(path: str) -> Any:
    if is_address(path):
        capture = open_address(path, 10_000, 10_000)
    elif is_file(path):
        _check_container(path)
        # the prefix keeps a name like "concat:a.avi" from opening another file
        capture = cv2.VideoCapture(os.path.join(os.curdir, path))  # noqa: PTH118 - pathlib drops the "./"
    else:
        raise CaptureError("there is no such video", where=path, advice="check the path")
    if not capture.isOpened():
        capture.release()
        raise CaptureError("cannot be opened as a video", where=path, advice="use MP4 (H.264) or AVI (MJPEG)")
    size = (int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    check_image_size(size, 0 if is_address(path) else Path(path).stat().st_size, path)
    return capture


def _check_container(path: str) -> None:
    """Refuse a file that does not begin like a video: a playlist would make OpenCV open other files and addresses."""
    with open_foreign(path, CaptureError) as file, reading(path, CaptureError, what="cannot be read"):
        head = file.read(1024)
    is_transport = any(len(head) > 2 * step and set(head[at::step]) == {0x47} for at, step in _TRANSPORT)
    if not is_transport and not _CONTAINER.match(head):
        check_kind(head, path, "film", CaptureError)
        raise CaptureError(
            "cannot be opened as a video (it does not begin like one)",
            where=path,
            advice="give the film's own file, no playlist: MP4 (H.264) or AVI (MJPEG)",
        )


def _bgr(image: Any) -> Image:
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.asarray(image, dtype=np.uint8)
