"""Sizes of pictures read from their headers, before a decoder allocates memory for them."""

import re
import struct
from collections.abc import Callable

from ...errors import CaptureError
from ...system.files import is_over_budget

_NO_LENGTH = frozenset((0x00, 0x01, *range(0xD0, 0xD9)))  # JPEG markers without a segment
_NO_FRAME = frozenset((0xC4, 0xC8, 0xCC))  # other segments among JPEG's frame headers, 0xC0 to 0xCF
_BLANK = rb"(?:\s|#[^\r\n]*[\r\n])*+"
_PORTABLE = re.compile(rb"P[1-6]" + _BLANK + rb"(\d{1,9})\D" + _BLANK + rb"(\d{1,9})")
_TIFF_WIDTHS, _TIFF_HEIGHTS = (256, 322), (257, 323)  # tags for the size of the image and of its tiles


def check_image_size(size: tuple[int, int], file_bytes: int, where: str) -> None:
    """Reject a picture (width, height) whose pixels need far more bytes than its file has; a stream has 0 bytes."""
    width, height = size
    if is_over_budget(width * height * 3, file_bytes):
        what = f"has {width} x {height} pixels, far more than its data can hold"
        raise CaptureError(what, where=where, advice="use smaller images")


def image_size(data: bytes) -> tuple[int, int]:
    """Return width and height in pixels, or raise ValueError."""
    reader = next((read for start, read in _READERS.items() if data.startswith(start)), None)
    try:
        size = reader(data) if reader else None
    except (struct.error, IndexError) as error:
        raise ValueError("cut off in its header") from error
    if size is None or 0 in size:
        raise ValueError("not a picture")
    return size


def _png(data: bytes) -> tuple[int, int] | None:
    if data[12:16] != b"IHDR":
        return None
    at, name, has_pixels = 8, b"", False
    while name != b"IEND" and at < len(data):
        length, name = struct.unpack_from(">I4s", data, at)
        at += 12 + length
        if at > len(data):  # the decoder would allocate memory for the declared length
            raise ValueError(f"cut off in its part {name!r}")
        has_pixels = has_pixels or name == b"IDAT"  # without pixel data, the decoder reads beyond the end
    return struct.unpack_from(">II", data, 16) if has_pixels else None


def _jpeg(data: bytes) -> tuple[int, int] | None:
    at = 2
    while (at := data.find(b"\xff", at) + 1) > 0:
        mark = data[at]
        if mark in _NO_LENGTH:
            at += 1
        elif 0xC0 <= mark <= 0xCF and mark not in _NO_FRAME:
            height, width = struct.unpack_from(">HH", data, at + 4)
            return width, height
        elif mark != 0xFF:
            at += 1 + max(struct.unpack_from(">H", data, at + 1)[0], 2)
    return None


def _bmp(data: bytes) -> tuple[int, int] | None:
    is_old = struct.unpack_from("<I", data, 14)[0] == 12
    width, height = struct.unpack_from("<HH" if is_old else "<ii", data, 18)
    return abs(width), abs(height)


def _tiff(data: bytes) -> tuple[int, int] | None:
    order = "<" if data.startswith(b"II") else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    values: dict[int, int] = {}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(order + "HH", data, entry)
        (value,) = struct.unpack_from(order + ("H" if kind == 3 else "I"), data, entry + 8)
        values[tag] = max(value, values.get(tag, 0))
    width, height = (max(values.get(tag, 0) for tag in tags) for tags in (_TIFF_WIDTHS, _TIFF_HEIGHTS))
    return width, height


def _webp(data: bytes) -> tuple[int, int] | None:
    kind = data[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    width, height = struct.unpack_from("<HH", data, 26)
    return (width & 0x3FFF, height & 0x3FFF) if kind == b"VP8 " else None


def _portable(data: bytes) -> tuple[int, int] | None:
    found = _PORTABLE.match(data)
    return (int(found[1]), int(found[2])) if found else None


_READERS: dict[bytes, Callable[[bytes], tuple[int, int] | None]] = {
    b"\x89PNG\r\n\x1a\n": _png,
    b"\xff\xd8": _jpeg,
    b"BM": _bmp,
    b"II*\0": _tiff,
    b"MM\0*": _tiff,
    b"RIFF": _webp,
    b"P": _portable,
}
