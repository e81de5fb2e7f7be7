"""Video files in codecs that the OpenCV packages of all systems can encode."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Image
from ...system.files import atomic_path

# File extension and FourCC. Huffyuv preserves every grey level; it can be read five times as fast as FFV1 and is
# a quarter larger. MPEG-4 plays on all systems but loses some levels.
LOSSLESS = (".mkv", "HFYU")
_MPEG4 = "mp4v"


@contextmanager
def open_video(path: Path, fps: float, size: tuple[int, int], code: str) -> Iterator[Callable[[Image], None]]:
    """Yield a function that appends an image (uint8 BGR) to a video; the file is finished at the end of the block.

    Raises:
        CaptureError: The file cannot be written, or an image has another size.
    """
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), fps, size)
    if not writer.isOpened():
        advice = "check that the folder exists and the disk is not full"
        raise CaptureError(f"cannot be written with codec {code}", where=str(path), advice=advice)

    def write(image: Image) -> None:
        if image.shape != (size[1], size[0], 3) or image.dtype != np.uint8:
            message = f"an image of shape {image.shape} does not fit a video of {size[0]}x{size[1]}"
            raise CaptureError(message, where=str(path), advice="give 8-bit colour images of one size")
        writer.write(image)

    try:
        yield write
    finally:
        writer.release()


def write_video(path: str | Path, frames: Iterable[Image], fps: float) -> int:
    """Write images to an MPEG-4 file and return their number.

    The file appears only once it is complete and opens again, because OpenCV's writer does not report a full disk.

    Raises:
        CaptureError: There are no images, their sizes differ, or the file cannot be written.
    """
    remaining = iter(frames)
    first = next(remaining, None)
    if first is None:
        raise CaptureError("there are no images for the video", where=str(path), advice="give at least one image")
    count = 1
    with atomic_path(path) as temporary:
        with open_video(temporary, fps, (first.shape[1], first.shape[0]), _MPEG4) as write:
            write(first)
            for image in remaining:
                write(image)
                count += 1
        reader = cv2.VideoCapture(str(temporary))
        readable = reader.isOpened() and reader.read()[0]
        reader.release()
        if not readable:
            raise CaptureError("the video could not be written", where=str(path), advice="check the free disk space")
    return count
