"""Writer for C3D marker takes (Intel order, real numbers, millimetres)."""

import struct
from pathlib import Path

import numpy as np

from ...errors import FormatError
from ...markers.marker_take import MarkerTake
from ...system.files import atomic_path

_BLOCK = 512
_INTEL = 84
_MOST_NAMES = 255  # most names in one parameter
_MOST_FRAMES = 0xFFFF  # largest number in a 16-bit word; the TRIAL group stores the end of longer takes
_CHARACTERS, _WORD, _REAL = -1, 2, 4


def write_c3d(take: MarkerTake, path: Path | str) -> None:
    """Write a take of at most 255 markers as C3D; missing frames and markers have the residual -1."""
    if len(take.names) > _MOST_NAMES:
        raise FormatError(
            f"{len(take.names)} markers do not fit, because a C3D file holds at most {_MOST_NAMES}",
            where=str(path),
            advice="write a .csv file",
        )
    rows = take.frame_numbers - take.frame_numbers[0]
    frames = int(rows[-1]) + 1
    first = int(take.frame_numbers[0]) if take.frame_numbers[0] >= 1 and take.frame_numbers[-1] <= _MOST_FRAMES else 1
    words = np.zeros((frames, len(take.names), 4), dtype="<f4")
    words[..., 3] = -1.0
    seen = take.visible
    located = np.where(seen[..., None], take.positions_m * 1000.0, 0.0)
    words[rows] = np.concatenate((located, np.where(seen, 0.0, -1.0)[..., None]), axis=-1)
    parameters = _parameters(take, first, frames)
    header = struct.pack(
        "<BBHHHHHfHHf", 2, 0x50, len(take.names), 0, first, min(first + frames - 1, _MOST_FRAMES), 0, -1.0,
        2 + len(parameters) // _BLOCK, 0, take.fps,
    )  # fmt: skip
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(header.ljust(_BLOCK, b"\0") + parameters)
        file.write(
            words.tobytes()
        )  # no padding, because readers derive the frame count of long takes from the file's size


def _parameters(take: MarkerTake, first: int, frames: int) -> bytes:
    """Return the parameter section in whole blocks."""
    width = max(len(name.encode("utf-8")) for name in take.names)
    labels = b"".join(name.encode("utf-8").ljust(width) for name in take.names)
    last = first + frames - 1
    point = [
        _parameter(1, "USED", _WORD, (), struct.pack("<H", len(take.names))),
        _parameter(1, "SCALE", _REAL, (), struct.pack("<f", -1.0)),
        _parameter(1, "RATE", _REAL, (), struct.pack("<f", take.fps)),
        _parameter(1, "FRAMES", _WORD, (), struct.pack("<H", min(frames, _MOST_FRAMES))),
        _parameter(1, "UNITS", _CHARACTERS, (2,), b"mm"),
        _parameter(1, "LABELS", _CHARACTERS, (width, len(take.names)), labels),
    ]
    trial = [
        _parameter(2, "ACTUAL_START_FIELD", _WORD, (2,), struct.pack("<HH", first & 0xFFFF, first >> 16)),
        _parameter(2, "ACTUAL_END_FIELD", _WORD, (2,), struct.pack("<HH", last & 0xFFFF, last >> 16)),
    ]
    analog = [_parameter(3, "USED", _WORD, (), struct.pack("<H", 0))]
    groups = [_group(1, "POINT"), *point, _group(2, "TRIAL"), *trial, _group(3, "ANALOG"), *analog]
    size = 4 + sum(map(len, groups)) + len(_start_of_data(0))
    blocks = -(-(size + 2) // _BLOCK)
    data_start = _start_of_data(2 + blocks)
    body = bytes((1, 0x50, blocks, _INTEL)) + b"".join(groups) + data_start
    return body.ljust(blocks * _BLOCK, b"\0")


def _start_of_data(block: int) -> bytes:
    return _parameter(1, "DATA_START", _WORD, (), struct.pack("<H", block))


def _group(number: int, name: str) -> bytes:
    return struct.pack("<bb", len(name), -number) + name.encode("ascii") + struct.pack("<hB", 3, 0)


def _parameter(group: int, name: str, kind: int, shape: tuple[int, ...], values: bytes) -> bytes:
    body = struct.pack("<bB", kind, len(shape)) + bytes(shape) + values + b"\0"  # empty description
    return struct.pack("<bb", len(name), group) + name.encode("ascii") + struct.pack("<h", len(body) + 2) + body
