"""Marker takes as TSV of Qualisys Track Manager: millimetres, tab-separated."""

from pathlib import Path

import numpy as np

from ...errors import FormatError
from ...geometry.arrays import Array
from ...markers.marker_take import MarkerTake
from ...system.files import read_bytes
from .reader_parts import frame_count, make_take, numbers_of

_METRES = 0.001  # of its unit; the file does not name it
_HEADER_LINES = 50  # more than any header has, events among them
_AHEAD = 2  # columns before the positions, frame and time, where they are exported
_NULL = "null"  # one export of missing values; others are blank and zeros


def read_tsv(path: Path | str) -> MarkerTake:
    """Return the take of a Qualisys TSV file with 3D data, in metres.

    Exports with and without column headers, frame numbers and times are read. NULL, blank fields and points at the very
    origin are missing positions.

    Raises:
        FormatError: another kind of TSV file or of Qualisys data, damaged, or without markers; names file and line.
    """
    where = str(path)
    lines = read_bytes(path).decode("utf-8-sig", errors="replace").splitlines()
    header, first = _header(lines, where)
    names = [name.strip() for name in header["MARKER_NAMES"]]
    while names and not names[-1]:
        names.pop()
    declared = _value(header, "NO_OF_MARKERS", where)
    if not names or declared != len(names):
        raise FormatError(f"declares {declared:g} markers and names {len(names)}", where=where)
    fps = _value(header, "FREQUENCY", where)
    if not fps > 0.0:
        raise FormatError("gives no frequency", where=where)
    rows = _rows(lines, first, 3 * len(names), where)
    ahead = rows.shape[1] - 3 * len(names)
    positions = rows[:, ahead:].reshape(len(rows), len(names), 3) * _METRES
    frames, times = (rows[:, 0], rows[:, 1]) if ahead else (None, None)
    return make_take(where, Path(where).stem, fps, names, positions, frames, times)


def declared_frames(path: Path | str) -> int:
    """Return how many frames the header promises; errors as in `read_tsv`."""
    header, _ = _header(read_bytes(path).decode("utf-8-sig", errors="replace").splitlines(), str(path))
    return frame_count(_value(header, "NO_OF_FRAMES", str(path)))


def _value(header: dict[str, list[str]], key: str, where: str) -> float:
    """Return the number of a header line, NaN without one."""
    return float(numbers_of((header.get(key) or ["nan"])[:1], where)[0])


def _header(lines: list[str], where: str) -> tuple[dict[str, list[str]], int]:
    """Return the header's fields by key, and the index of the first line of numbers."""
    header: dict[str, list[str]] = {}
    for number, line in enumerate(lines[:_HEADER_LINES]):
        key, *fields = line.split("\t")
        if "MARKER_NAMES" in header and _is_data(line):
            if (header.get("DATA_INCLUDED") or ["3D"])[0].strip().upper() != "3D":
                raise FormatError("holds no 3D data", where=where, advice="export 3D data from QTM")
            return header, number
        header.setdefault(key.strip().upper(), fields)
    advice = "export with the header from QTM"
    if "MARKER_NAMES" in header:
        raise FormatError("has no frames", where=where)
    raise FormatError("is no marker export of Qualisys (it has no line MARKER_NAMES)", where=where, advice=advice)


def _is_data(line: str) -> bool:
    try:
        numbers_of(_fields(line), "")
    except FormatError:
        return False
    return True


def _fields(line: str) -> list[str]:
    return ["" if field.strip().lower() == _NULL else field for field in line.split("\t")]


def _rows(lines: list[str], first: int, width: int, where: str) -> Array:
    """Return the frames' numbers, after frame and time if the file has them."""
    rows: list[list[float]] = []
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line:
            continue
        fields = _fields(line)
        if len(fields) in (width + 1, width + _AHEAD + 1) and not fields[-1].strip():
            fields.pop()  # of a tab at the end
        if len(fields) not in (width, width + _AHEAD) or (rows and len(fields) != len(rows[0])):
            expected = len(rows[0]) if rows else width
            raise FormatError(
                f"has {len(fields)} fields, not {expected}", where=f"{where}, line {number}",
                advice="the file is cut off or damaged",
            )  # fmt: skip
        rows.append(numbers_of(fields, f"{where}, line {number}"))
    if not rows:
        raise FormatError("has no frames", where=where)
    return np.array(rows)
