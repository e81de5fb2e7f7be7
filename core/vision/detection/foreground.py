"""Pixels that differ from an empty room."""

import cv2
import numpy as np

from ...geometry.arrays import Image
from ...kernel.library import address, checked, function, stage

_DIFFERING = function("differing", "nnnppnpnpp")


def _compiled(image: Image, low: Image, width: Image) -> tuple[Image, int, int]:
    if any(each.dtype != np.uint8 or each.strides[1:] != (3, 1) for each in (image, low, width)):
        return differing.numpy_body(image, low, width)
    height, columns = image.shape[:2]
    mask, ends = np.empty((height, columns), dtype=np.uint8), np.empty(2, dtype=np.int64)
    rooms = _start(low), low.strides[0], _start(width), width.strides[0]
    checked(_DIFFERING(height, columns, image.strides[0], _start(image), *rooms, address(mask), address(ends)))
    return mask, int(ends[0]), int(ends[1])


def _start(pixels: Image) -> int:
    """Return where the first of some pixels lies, whose rows may be apart."""
    return int(pixels.ctypes.data)


@stage(_compiled)
def differing(image: Image, low: Image, width: Image) -> tuple[Image, int, int]:
    """Return a mask (h, w), 255 where an image differs from an empty room, and its first and last such column.

    Where nothing differs, the last column is -1.

    Args:
        image: Pixels (h, w, 3).
        low: Smallest value (h, w, 3) of the empty room in each pixel and channel.
        width: Its largest value minus the smallest.
    """
    # values below the band wrap around to above it: much faster than cv2.inRange with bounds for each pixel
    above_low = np.subtract(image, low)
    outside = np.asarray(cv2.compare(above_low, width, cv2.CMP_GT, dst=above_low))
    blue, green, red = cv2.split(outside)
    mask = np.asarray(cv2.bitwise_or(cv2.bitwise_or(blue, green, dst=blue), red, dst=blue), dtype=np.uint8)
    columns = np.maximum.reduce(mask, axis=0).nonzero()[0]
    return (mask, int(columns[0]), int(columns[-1])) if len(columns) else (mask, 0, -1)
