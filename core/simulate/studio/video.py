"""Video files in codecs that OpenCV's wheels can encode everywhere."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Image
from ...system.files import atomic_path

# container and four-letter code; Huffyuv keeps every grey level and is read five times as fast as FFV1, in a quarter
# more bytes; MPEG-4 plays everywhere but loses some
LOSSLESS = (".mkv", "HFYU")
SMALL = (".mp4", "mp4v")


class VideoWriter:
    """One open video file; `write` takes uint8 BGR images of one size."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int], code: str) -> None:
        self.path = path
        self.size = size
        self._writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), fps, size)
        if not self._writer.isOpened():
            raise CaptureError(f"cannot be written with codec {code}", where=str(path), advice="check folder and disk")

    def write(self, image: Image) -> None:
        """Append an image; CaptureError when its size is not the video's."""
        if (image.shape[1], image.shape[0]) != self.size or image.dtype != np.uint8 or image.ndim != 3:
            raise CaptureError(
                f"an image of shape {image.shape} does not fit a video of {self.size[0]}x{self.size[1]}",
                where=str(self.path),
            )
        self._writer.write(image)

    def close(self) -> None:
        """Finish the file."""
        self._writer.release()


@contextmanager
def open_video(path: Path, fps: float, size: tuple[int, int], code: str) -> Iterator[VideoWriter]:
    """Yield a writer for a video file; it is finished at the end of the block."""
    writer = VideoWriter(path, fps, size, code)
    try:
        yield writer
    finally:
        writer.close()


def write_video(path: str | Path, frames: Iterable[Image], fps: float, code: str = SMALL[1]) -> int:
    """Write images to a video file; return their number.

    The file appears only when it is whole and opens again.

    Raises:
        CaptureError: no images, images of different size, or the file cannot be written.
    """
    remaining = iter(frames)
    first = next(remaining, None)
    if first is None:
        raise CaptureError("there are no images for the video", where=str(path))
    count = 1
    with atomic_path(path) as temporary:
        with open_video(temporary, fps, (first.shape[1], first.shape[0]), code) as video:
            video.write(first)
            for image in remaining:
                video.write(image)
                count += 1
        _check(temporary, Path(path))
    return count


def _check(temporary: Path, target: Path) -> None:
    """Check that the written file is a video.

    OpenCV's writer reports no full disk.
    """
    reader = cv2.VideoCapture(str(temporary))
    readable = reader.isOpened() and reader.read()[0]
    reader.release()
    if not readable:
        raise CaptureError("the video could not be written", where=str(target), advice="check the free disk space")
