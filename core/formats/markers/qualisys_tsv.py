"""Marker takes as TSV exports of Qualisys Track Manager, in millimetres."""

from collections.abc import Iterator
from pathlib import Path

from ...errors import FormatError
from ...markers.marker_take import MarkerTake
from ...system.files import read_bytes
from .reader_parts import lines_of, make_take, numbers_of, table_of

_KIND = "Qualisys export"
_METRES = 0.001  # metres per unit, which the file does not name
_HEADER_LINES = 50  # more lines than any header has, including events
_AHEAD = 2  # largest number of optional columns before the positions: frame and time


def read_tsv(path: Path | str) -> MarkerTake:
    """Return the take of a Qualisys TSV file with 3D data, in metres.

    Exports with and without column headers, frame numbers and times are read. NULL, blank fields and points exactly at
    the origin are missing positions.

    Raises:
        FormatError: The file is of the wrong kind, is damaged, or has no markers; names file and line.
    """
    where, data = str(path), read_bytes(path)
    lines = lines_of(data, where, _KIND)
    header, first = _header(lines, where)
    names = [name.strip() for name in header["MARKER_NAMES"]]
    while names and not names[-1]:
        names.pop()
    declared = _value(header, "NO_OF_MARKERS", where)
    if not names or declared != len(names):
        raise FormatError(
            f"declares {declared:g} markers but names {len(names)}", where=where, advice="export it again"
        )
    width = 3 * len(names)
    ahead = _AHEAD if len(_fields(lines[first], width)) == width + _AHEAD else 0
    rows = table_of(_rows(lines, first, width, ahead, where), len(lines), ahead + width, len(data), where)
    positions = rows[:, ahead:].reshape(len(rows), len(names), 3) * _METRES
    frames, times = (rows[:, 0], rows[:, 1]) if ahead else (None, None)
    rate, declared = (_value(header, key, where) for key in ("FREQUENCY", "NO_OF_FRAMES"))
    return make_take(where, rate, names, positions, frames, times, declared)


def _value(header: dict[str, list[str]], key: str, where: str) -> float:
    """Return the number in a header line, NaN if there is none."""
    return float(numbers_of((header.get(key) or ["nan"])[:1], where)[0])


def _header(lines: list[str], where: str) -> tuple[dict[str, list[str]], int]:
    """Return the header's fields by key, and the index of the first line of numbers."""
    header: dict[str, list[str]] = {}
    for number, line in enumerate(lines[:_HEADER_LINES]):
        key, *fields = line.split("\t")
        if "MARKER_NAMES" in header and line and _is_data(line):
            if (header.get("DATA_INCLUDED") or ["3D"])[0].strip().upper() != "3D":
                raise FormatError("holds no 3D data", where=where, advice="export 3D data from QTM")
            return header, number
        header.setdefault(key.strip().upper(), fields)
    advice = "export it from QTM with the header"
    if "MARKER_NAMES" in header:
        raise FormatError("has no frames", where=where, advice="export it again")
    raise FormatError("is not a Qualisys marker export (it has no line MARKER_NAMES)", where=where, advice=advice)


def _is_data(line: str) -> bool:
    try:
        numbers_of(_fields(line, 0), "")
    except FormatError:
        return False
    return True


def _fields(line: str, width: int) -> list[str]:
    """Return the fields of a row of `width` positions, without a trailing tab and with NULL as blank."""
    fields = ["" if field.strip().lower() == "null" else field for field in line.split("\t")]
    return fields[:-1] if len(fields) in (width + 1, width + _AHEAD + 1) and not fields[-1].strip() else fields


def _rows(lines: list[str], first: int, width: int, ahead: int, where: str) -> Iterator[tuple[list[str], str]]:
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line:
            continue
        fields, place = _fields(line, width), f"{where}, line {number}"
        if len(fields) != width + ahead:
            advice = "export it again"
            raise FormatError(f"has {len(fields)} fields, not {width + ahead}", where=place, advice=advice)
        yield fields, place
