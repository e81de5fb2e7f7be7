"""Blocks of numbers in text files."""

import warnings

import numpy as np
from numpy.typing import NDArray

from ...errors import FormatError
from ...geometry.arrays import Array
from ...system.files import SLACK_BYTES

_POSE_BYTES = 32  # of a joint in a frame
_MOST_TIMES = 4  # the poses' bytes by the file's
_PIECE = 1 << 17  # bytes of text read at once: the arrays made of them fit into a processor's cache
_MARGIN = b" " * 9
_TAB, _RETURN, _SPACE, _MINUS, _POINT = b"\t\r -."
_EIGHT_DIGITS = np.uint64(10**8)
_ZEROS, _HIGH_BITS, _ABOVE_NINE = (np.uint64(byte * 0x0101010101010101) for byte in (0x30, 0x80, 0x76))
# factors that add each two neighbours, in turn digits, pairs and fours; bits of these; bytes that count
_SUMS = tuple(
    (np.uint64((base << bits) + 1), np.uint64(bits), np.uint64(mask))
    for base, bits, mask in ((10, 8, 2**64 - 1), (100, 16, 0x00FF00FF00FF00FF), (10**4, 32, 0x0000FFFF0000FFFF))
)


def parse_numbers(text: bytes) -> Array | None:
    """Return all numbers of a text, or None when it holds anything else."""
    parts: list[Array] = []
    start = 0
    while start < len(text):
        stop = len(text)
        if stop - start > _PIECE:
            stop = max(text.rfind(blank, start, start + _PIECE) for blank in (b"\n", b" ", b"\t")) + 1
        numbers = _decimals(text[start:stop])
        if numbers is None:
            return _any_numbers(text)
        parts.append(numbers)
        start = stop
    return np.concatenate(parts) if parts else np.empty(0)


def _any_numbers(text: bytes) -> Array | None:
    with warnings.catch_warnings():
        # numpy 1 warns about what it cannot read, numpy 2 raises
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def _decimals(text: bytes) -> Array | None:
    """Return all numbers of a text, None unless all are like -12.345.

    The eight digits before and behind each point are computed in one 64-bit number each, those of all numbers at once;
    to convert them one by one takes twice as long. The result is the same, to the last bit.
    """
    data = np.frombuffer(_MARGIN + text + _MARGIN, dtype=np.uint8)
    blank = data <= _SPACE
    # where each number begins, has its point, and ends
    edges = np.flatnonzero((blank[1:] != blank[:-1]) | (data[1:] == _POINT)) + 1
    begins, points, ends = edges[::3], edges[1::3], edges[2::3]
    if len(begins) == 0 or len(begins) != len(ends) or not np.all((data[points] == _POINT) & blank[ends]):
        return None
    if np.any((data < _TAB) | ((data > _RETURN) & (data < _SPACE))):  # blank for nobody else
        return None
    negative = data[begins] == _MINUS
    before, behind = points - begins - negative, ends - points - 1
    if np.min(before) < 1 or np.max(before) > 7 or np.min(behind) < 1 or np.max(behind) > 8:
        return None
    words: NDArray[np.uint64] = np.ndarray((len(data) - 7,), "<u8", data, strides=(1,))
    # digits that are not of the number become zeros
    lacking = (64 - 8 * before).astype(np.uint64)
    whole = (words[points - 8] ^ _ZEROS) >> lacking << lacking
    lacking = (64 - 8 * behind).astype(np.uint64)
    part = (words[points + 1] ^ _ZEROS) << lacking >> lacking
    if np.any(((whole + _ABOVE_NINE) | whole | (part + _ABOVE_NINE) | part) & _HIGH_BITS):
        return None
    numbers = (_eight_digits(whole) * _EIGHT_DIGITS + _eight_digits(part)).astype(np.float64) / float(_EIGHT_DIGITS)
    return np.negative(numbers, out=numbers, where=negative)


def _eight_digits(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return numbers of eight digits, a byte each from the lowest one (Lemire 2022)."""
    for factor, bits, mask in _SUMS:
        words = (words & mask) * factor >> bits
    return words


def check_pose_bytes(frames: int, joints: int, file_bytes: int, where: str) -> None:
    """Raise FormatError if joints without numbers make poses huge by the file."""
    if frames * joints * _POSE_BYTES > _MOST_TIMES * file_bytes + SLACK_BYTES:
        raise FormatError(
            f"has {frames} frames of {joints} joints, far more than its bytes", where=where,
            advice="leave out the joints without numbers, or cut it into parts",
        )  # fmt: skip
