"""Numbers in MAT files of version 5 to 7 (MathWorks, "MAT-File Format", level 5)."""

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from .arrays import Array

_HEADER = 128  # bytes
_MATRIX, _COMPRESSED = 14, 15  # types of elements that hold others
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CELL, _STRUCTURE = 1, 2  # classes of matrices
_NUMERIC = range(6, 16)
_MOST_BYTES = 10_000_000  # of an element once it is decompressed
_MOST_NAMES = 100_000  # bytes of the names of a structure's fields
_MOST_DEPTH = 20  # structures in structures


def read_mat(raw: bytes) -> dict[str, Any]:
    """Return the variables of a MAT file by name.

    Structures become dicts, arrays of structures and cells lists, numbers arrays; texts and objects become None.

    Raises:
        ValueError, OverflowError, IndexError, struct.error, zlib.error: The file is damaged.
    """
    order = {b"IM": "<", b"MI": ">"}.get(raw[126:_HEADER])
    if order is None:
        raise ValueError("the header does not state the order of bytes")
    found: list[tuple[int, bytes]] = []
    for kind, content in _elements(raw[_HEADER:], order):
        if kind == _COMPRESSED:
            found += _elements(zlib.decompressobj().decompress(content, _MOST_BYTES), order)
        else:
            found.append((kind, content))
    matrices = [_matrix(content, order, 0) for kind, content in found if kind == _MATRIX]
    return {name: value for name, value in matrices if name}  # objects lie in one without a name


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield the type and the content of each element."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}2I", data, at)
        is_small = kind > 0xFFFF  # type, size and up to four bytes of content share eight bytes
        begin = at + (4 if is_small else 8)
        kind, size = (kind & 0xFFFF, kind >> 16) if is_small else (kind, size)
        content = data[begin : begin + size]
        if len(content) < size or (is_small and size > 4):
            raise ValueError("an element is longer than its file")
        yield kind, content
        at = at + 8 if is_small else begin + size + (0 if kind == _COMPRESSED else -size % 8)


def _matrix(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    """Return name and value of a matrix."""
    if not data:
        return "", None
    if depth > _MOST_DEPTH:
        raise ValueError("structures are nested too deeply")
    parts = list(_elements(data, order))
    if len(parts) < 3:
        raise ValueError("a matrix lacks its name")
    kind = int(_numbers(parts[0], order)[0]) & 0xFF
    shape, name = [int(size) for size in _numbers(parts[1], order)], parts[2][1].decode("latin-1")
    if kind in _NUMERIC:
        return name, _numbers(parts[3], order).reshape(shape, order="F")
    if kind == _CELL:
        return name, [_matrix(content, order, depth + 1)[1] for _, content in parts[3:]]
    if kind != _STRUCTURE:
        return name, None
    width, names = max(int(_numbers(parts[3], order)[0]), 1), parts[4][1]
    if len(names) > _MOST_NAMES:
        raise ValueError("a structure has too many fields")
    fields = [names[at : at + width].split(b"\0")[0].decode("latin-1") for at in range(0, len(names), width)]
    values = [_matrix(content, order, depth + 1)[1] for _, content in parts[5:]]
    size = max(len(fields), 1)
    rows = [dict(zip(fields, values[at : at + size], strict=False)) for at in range(0, len(values), size)]
    return name, rows[0] if len(rows) == 1 else rows


def _numbers(part: tuple[int, bytes], order: str) -> Array:
    kind, content = part
    if kind not in _NUMBERS:
        raise ValueError(f"an element of type {kind} has no numbers")
    return np.frombuffer(content, order + _NUMBERS[kind]).astype(np.float64)
