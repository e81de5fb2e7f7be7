"""Video files as a source."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...errors import CaptureError, counted
from ...geometry.arrays import Image
from ...system.file_content import content_kind
from ...system.files import is_file, open_foreign, reading
from .addresses import is_address
from .camera_watch import is_repeated
from .image_files import open_address
from .image_header import check_image_size
from .image_set import ClosableSource, ImageSet, next_number
from .source_settings import SOURCES

_CONTAINER = re.compile(
    rb"RIFF....AVI |\x1aE\xdf\xa3|....(?:ftyp|moov|mdat|wide|free|skip|pnot)|\x00\x00\x01[\xba\xb3]"
    rb"|\x30\x26\xb2\x75\x8e\x66\xcf\x11|FLV\x01|OggS|\x06\x0e\x2b\x34",
    re.DOTALL,
)  # AVI, Matroska and WebM, MP4 and MOV, MPEG, WMV, Flash, Ogg, MXF
_TRANSPORT = ((0, 188), (4, 192))  # offset of a packet's sync byte and packet length, in MPEG-TS and camcorders' M2TS


_CODECS = {"av01": "AV1", "hvc1": "H.265", "hev1": "H.265", "hevc": "H.265", "vp09": "VP9", "vp90": "VP9"}


class VideoSource(ClosableSource):
    """Image sets from one video per camera; files can be iterated any number of times.

    Images have the time stamps of their videos, so that variable rates and lost frames are preserved; times within a
    quarter of a frame of a steady rate are rounded to it. An image set contains the images of one moment. An
    image that one video lacks, or shows twice while another goes on, is marked unusable. If videos have different
    rates, the image sets follow the frames of the slowest.

    Args:
        paths: Video files or addresses of videos, one per camera.
        fps: Rate to use if a file does not state it.
        starts_s: Times at which the videos begin, on one clock; only the part that all show is read. By default they
            begin together.
        together: Refuse videos of different lengths. Otherwise their images come one by one, each in a set of its own,
            with times from the start of its own video.

    Attributes:
        warnings: Faults in the frames so far.
        is_apart: Whether images come one by one.

    Raises:
        CaptureError: A file is missing or unreadable, or the lengths differ (also during iteration).
    """

    def __init__(
        self,
        paths: Sequence[str | Path],
        fps: float = 30.0,
        *,
        starts_s: Sequence[float] = (),
        together: bool = True,
    ) -> None:
        self._paths = [str(path) for path in paths]
        self.name = Path(self._paths[0]).stem
        self._counts, self._rates = [], []
        for path in self._paths:
            capture = _open(path)
            self._counts.append(max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0))
            rate = float(capture.get(cv2.CAP_PROP_FPS))
            self._rates.append(rate if 1.0 <= rate <= 1000.0 else fps)
            capture.release()
        has_rates = max(self._rates) > SOURCES.other_rate * min(self._rates)
        fault = None if starts_s else self._length_fault()
        if fault and together:
            raise fault
        self.is_apart = fault is not None
        self._starts_s = tuple(starts_s)
        self._has_rates = has_rates or bool(starts_s)
        self._lead = int(np.argmin(self._rates)) if self._has_rates or self.is_apart else 0
        self.fps = self._rates[self._lead]
        self.frames = sum(self._counts) if self.is_apart else self._common_frames()
        rates = ", ".join(f"{Path(p).name} {rate:g}" for p, rate in zip(self._paths, self._rates, strict=True))
        told = f"the videos have different frame rates ({rates}): their images are paired by time"
        self._notes = (told,) * has_rates
        self.warnings = self._notes

    def _common_frames(self) -> int:
        """Return the number of frames of the part that all videos show."""
        if not self._starts_s:
            return min(self._counts)
        rows = zip(self._starts_s, self._counts, self._rates, strict=True)
        common_s = min(start_s + count / rate for start_s, count, rate in rows) - max(self._starts_s)
        return max(round(common_s * self.fps), 0)

    def _length_fault(self) -> CaptureError | None:
        """Return an error for videos whose lengths say that they do not show the same moments."""
        seconds = [count / rate for count, rate in zip(self._counts, self._rates, strict=True)]
        is_alike = max(self._rates) <= SOURCES.same_rate * min(self._rates)
        is_apart = max(seconds) - min(seconds) > SOURCES.end_frames / min(self._rates)
        if min(self._counts) == 0 or not (len(set(self._counts)) > 1 if is_alike else is_apart):
            return None
        rows = zip(self._paths, self._counts, seconds, strict=True)
        lengths = [f"{Path(p).name} {n} frames" + f" in {s:.2f} s" * (not is_alike) for p, n, s in rows]
        advice = "cut them so that they start and end at the same moments"
        return CaptureError("the videos have different lengths: " + ", ".join(lengths), advice=advice)

    def __iter__(self) -> Iterator[ImageSet]:
        with ExitStack() as stack:
            captures = [_open(path) for path in self._paths]
            for capture in captures:
                stack.callback(capture.release)
            starts_s = self._starts_s or (0.0,) * len(captures)
            readers = [_Reader(*each) for each in zip(captures, self._rates, starts_s, strict=True)]
            lead = readers[self._lead]
            self._advance(readers, readers)
            if self.is_apart:
                yield from self._one_by_one(readers)
                return
            for reader in readers if self._starts_s else ():
                reader.read_until(max(starts_s))
            while not self._closed and lead.image is not None:
                first_s = lead.time_s if self._has_rates else min(reader.time_s for reader in readers)
                current = [reader for reader in readers if abs(reader.time_s - first_s) <= 0.5 / reader.fps]
                yield self._image_set(readers, current, first_s)
                self.warnings = self._warnings(readers)
                self._advance(readers, [lead] if self._has_rates else current)

    def _one_by_one(self, readers: Sequence["_Reader"]) -> Iterator[ImageSet]:
        """Yield each image in a set of its own, by time, with black ones for the other videos."""
        black = [np.zeros_like(reader.image) for reader in readers]
        number = 0
        while not self._closed and (left := [reader for reader in readers if reader.image is not None]):
            own = min(left, key=lambda reader: reader.time_s)
            if not own.is_repeated:
                rows = zip(readers, black, strict=True)
                images = tuple(reader.image if reader is own else dark for reader, dark in rows)
                usable = tuple(reader is own for reader in readers)
                yield ImageSet(number, (own.time_s,) * len(readers), images, usable=usable)
                number += 1
            own.read()

    def _image_set(self, readers: Sequence["_Reader"], current: Sequence["_Reader"], first_s: float) -> ImageSet:
        """Return an image set with the images of the `current` videos, and black ones for the others."""
        repeated = [reader.is_repeated for reader in readers]
        usable = tuple(
            # a repetition in all videos means that nothing moved
            reader in current and (not reader.is_repeated or all(repeated))
            for reader in readers
        )
        for reader, use in zip(readers, usable, strict=True):
            reader.lost += reader not in current
            reader.doubled += reader in current and not use
        images = tuple(
            reader.image if use else np.zeros_like(reader.image) for reader, use in zip(readers, usable, strict=True)
        )
        times_s = tuple(reader.time_s if reader in current else first_s for reader in readers)
        number = readers[self._lead].number if self._starts_s else min(reader.number for reader in current)
        return ImageSet(number, times_s, images, usable=usable)

    def _advance(self, readers: Sequence["_Reader"], current: Sequence["_Reader"]) -> None:
        """Read the next frames of the `current` videos; at the end of the source, remove all readers' images."""
        lead = readers[self._lead]
        before = lead.number if self._has_rates else max(reader.number for reader in readers)
        for reader in current:
            reader.read()
        if self._has_rates and lead.image is not None:
            for reader in readers:
                reader.read_until(lead.time_s)
        ended = [path for path, reader in zip(self._paths, readers, strict=True) if reader.image is None]
        if ended and before < 0:
            codec = next(reader.codec for reader in readers if reader.image is None)
            what = f"is a video in {codec}, which cannot be read here" if codec else "has no image that can be read"
            raise CaptureError(what, where=ended[0], advice="convert it to H.264 (MP4), or to AVI (MJPEG)")
        if ended and self._starts_s:
            lead.image = None
            return
        # the last frames of one video may be missing
        if ended and not all(reader.ends_within(SOURCES.end_frames / self.fps) for reader in readers):
            raise CaptureError(
                f"ends after {counted(before + 1, 'frame')}, before another video",
                where=ended[0],
                advice="cut the videos to the same length",
            )
        if ended:
            lead.image = None
        if ended and before + 1 < self.frames - 1:  # some containers announce one frame too many
            raise CaptureError(
                f"cannot be read after frame {before + 1} of {self.frames}",
                where=ended[0],
                advice="the file is damaged: export it again",
            )

    def _warnings(self, readers: Sequence["_Reader"]) -> tuple[str, ...]:
        found = list(self._notes)
        for path, reader in zip(self._paths, readers, strict=True):
            if reader.doubled:
                found.append(f"{Path(path).name} shows {counted(reader.doubled, 'frame')} twice: repeats were left out")
            if reader.lost:
                found.append(f"{Path(path).name} lacks {counted(reader.lost, 'frame')} that another video has")
        return tuple(found)

    def samples(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield images of up to `count` moments spread over files of known length."""
        if self.frames <= 0:
            return
        wanted = [int(i) for i in np.unique(np.linspace(0, self.frames - 1, count).astype(int))]
        with ExitStack() as stack:
            captures = [_open(path) for path in self._paths]
            for capture in captures:
                stack.callback(capture.release)
            at = [-1] * len(captures)
            for index in wanted:
                for i, capture in enumerate(captures):
                    place = round(index * self._rates[i] / self.fps) if self._has_rates else index
                    # seeking is inexact in many containers
                    while at[i] < place:
                        if not capture.grab():
                            return
                        at[i] += 1
                yield tuple(_bgr(capture.retrieve()[1]) for capture in captures)


class _Reader:
    """Reader of one video, whose first frame has the time stamp `start_s`."""

    def __init__(self, capture: Any, fps: float, start_s: float) -> None:
        self.number = -1
        self.time_s = start_s
        self.image: Any = None
        self.codec = _codec_of(capture)
        self.is_repeated = False
        self.lost = 0
        self.doubled = 0
        self.fps = fps
        self._capture = capture
        self._start_s = start_s
        self._first_s = 0.0
        self._stamp_s = 0.0
        self._is_steady = True  # as far as is known

    def read(self) -> None:
        """Read the next frame; `image` is None at the end."""
        ok, image = self._capture.read()
        if not ok:
            self.image = None
            return
        image = _bgr(image)
        self.is_repeated = self.image is not None and is_repeated(self.image, image)
        self.image = image
        stamp_s = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
        if self.number < 0:
            self.number, self._first_s, self._stamp_s = 0, stamp_s - self._start_s, stamp_s
            return
        passed_s = stamp_s - self._stamp_s
        self._stamp_s = stamp_s
        self.number = next_number(self.number, passed_s, 1.0 / self.fps)
        since_s, steady_s = stamp_s - self._first_s, self._start_s + self.number / self.fps
        if passed_s <= 0.0:  # the video has no time stamps
            self.time_s += 1.0 / self.fps
            return
        self._is_steady &= abs(since_s - steady_s) <= SOURCES.stamp_jitter / self.fps
        self.time_s = steady_s if self._is_steady else max(since_s, self.time_s + SOURCES.least_step / self.fps)
        if not self._is_steady:
            self.number = max(self.number, round((self.time_s - self._start_s) * self.fps))

    def read_until(self, time_s: float) -> None:
        """Read the frame nearest to a moment, or the last one before it."""
        while self.image is not None and self.time_s < time_s - 0.5 / self.fps:
            self.read()

    def ends_within(self, seconds: float) -> bool:
        """Continue reading; return whether the video ended within this time."""
        last_s = self.time_s + seconds + 0.5 / self.fps
        while self.image is not None and self.time_s < last_s:
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
    """Reject a file that does not start like a video: a playlist would make OpenCV open other files and addresses."""
    with open_foreign(path, CaptureError) as file, reading(path, CaptureError, what="cannot be read"):
        head = file.read(1024)
    is_transport = any(len(head) > 2 * step and set(head[at::step]) == {0x47} for at, step in _TRANSPORT)
    if not is_transport and not _CONTAINER.match(head):
        kind = content_kind(head)
        raise CaptureError(
            f"cannot be opened as a video (it does not begin like one{f': it is {kind}' if kind else ''})",
            where=path,
            advice="give the video itself, not a playlist: MP4 (H.264) or AVI (MJPEG)",
        )


def _codec_of(capture: Any) -> str:
    """Return the name of a video's codec, or "" if it is unknown."""
    letters = (int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF).to_bytes(4, "little").decode("latin-1")
    known = _CODECS.get(letters.lower(), letters)
    return known if known.isprintable() and not known.isspace() else ""


def _bgr(image: Any) -> Image:
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.asarray(image, dtype=np.uint8)
