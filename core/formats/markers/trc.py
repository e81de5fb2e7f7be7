"""TRC marker trajectories (Motion Analysis, OpenSim)."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from ...errors import FormatError
from ...geometry.arrays import Array, Mask
from ...markers.marker_take import MarkerTake
from ...system.files import atomic_path, read_bytes
from .reader_parts import lines_of, make_take, metres_of, separator_of, table_of

_KIND = "TRC file"


def read_trc(path: Path | str) -> MarkerTake:
    """Return the take in a TRC file, in metres.

    Blank fields, every spelling of NaN and points exactly at the origin are missing positions; rows may end early.
    Points without a name are ignored. If the data rate is zero, the times determine it. Semicolons, commas or spaces
    may replace the tabs, and tabs may be doubled.

    Raises:
        FormatError: The file is not TRC, is damaged, or has no markers; names file and line.
    """
    where, data = str(path), read_bytes(path)
    lines = lines_of(data, where, _KIND)
    header = _header(lines, where)
    if len(lines) < 5:
        raise FormatError("ends within its header", where=f"{where}, line {len(lines)}", advice="export it again")
    separator = separator_of(lines[1])
    names = _names(lines[3].split(separator), header, where)
    width = 2 + 3 * len(names)
    fields = _fields_without_separators(lines, header, where) if separator is None else _fields(lines, separator)
    rows = table_of(_rows(fields, width, where), len(lines), width, len(data), where)
    positions = rows[:, 2:].reshape(len(rows), len(names), 3) * metres_of(header.get("units", "mm"), where)
    rate, declared = (_number(header.get(key, "")) for key in ("datarate", "numframes"))
    return make_take(where, rate, names, positions, rows[:, 0], rows[:, 1], declared)


def _header(lines: list[str], where: str) -> dict[str, str]:
    if not lines[0].lower().startswith("pathfiletype"):
        raise FormatError(
            "is not a TRC file (it does not begin with PathFileType)", where=where, advice="export it as TRC"
        )
    if len(lines) < 3:
        raise FormatError("ends within its header", where=where, advice="export it again")
    keys, values = ([field.strip() for field in line.split(separator_of(lines[1]))] for line in lines[1:3])
    # spreadsheets and some programs double the tabs in one of these lines
    if any(values[len(keys) :]) or ("" in keys and any(keys[len(values) :])):
        keys, values = ([field for field in fields if field] for fields in (keys, values))
    header = {k.lower(): v for k, v in zip(keys, values, strict=False)}
    if "units" not in header and "datarate" not in header:
        raise FormatError("has no header values", where=f"{where}, line 3", advice="export it again")
    return header


def _number(text: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return float("nan")


def _names(fields: list[str], header: dict[str, str], where: str) -> list[str]:
    # some writers shift the names by a column relative to the data, so only their order counts
    names = [field.strip() for field in fields[2:] if field.strip()]
    names = names[1:] if names[:1] == ["Time"] and not fields[1].strip() else names
    declared = _number(header.get("nummarkers", ""))
    if not names:
        advice = "name the points in the program that wrote it"
        raise FormatError("has no markers with a name", where=f"{where}, line 4", advice=advice)
    if declared < len(names):
        what = f"declares {declared:g} markers but names {len(names)}"
        raise FormatError(what, where=f"{where}, line 4", advice="export it again")
    return names


def _fields(lines: list[str], separator: str) -> Iterator[list[str]]:
    """Yield the fields of all lines after the header; separators that are always doubled count once."""
    step = 0
    for line in lines[5:]:
        fields = line.split(separator)
        if step == 0 and fields[0].strip():
            step = 2 if any(map(str.strip, fields[2:])) and not any(map(str.strip, fields[1::2])) else 1
        yield fields[:: max(step, 1)]


def _fields_without_separators(lines: list[str], header: dict[str, str], where: str) -> Iterator[list[str]]:
    """Yield the words of all lines after the header; each line must contain every value."""
    markers = _number(header.get("nummarkers", ""))
    for number, line in enumerate(lines[5:], start=6):
        fields = line.split() or [""]
        if fields[0] and len(fields) != 2 + 3 * markers:
            advice = "export it with tabs: fields separated by blanks do not show which value is missing"
            what = f"has {len(fields)} of {2 + 3 * markers:g} values"
            raise FormatError(what, where=f"{where}, line {number}", advice=advice)
        yield fields


def _rows(table: Iterable[list[str]], width: int, where: str) -> Iterator[tuple[list[str], str]]:
    for number, fields in enumerate(table, start=6):
        if not fields[0].strip():
            continue
        place = f"{where}, line {number}"
        # Vicon and BTK put points without a name after the named ones; these are ignored
        beyond = len(fields) - width
        while beyond > 0 and not fields[width + beyond - 1].strip():
            beyond -= 1
        if beyond > 0 and beyond % 3:
            raise FormatError(f"has more than {width} fields", where=place, advice="export it again")
        yield fields, place


def write_trc(take: MarkerTake, path: Path | str) -> None:
    """Write a take as TRC in millimetres; missing positions are blank."""
    rate = f"{take.fps:.6g}"
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{take.frames}\t{len(take.names)}\tmm\t{rate}\t{take.frame_numbers[0]}\t{take.frames}",
        "Frame#\tTime\t" + "\t\t\t".join(take.names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i}" for i in range(1, len(take.names) + 1) for axis in "XYZ"),
        "",
    ]
    millimetres = (take.positions_m * 1000.0).reshape(take.frames, -1)
    for number, time, row in zip(take.frame_numbers, take.times_s, millimetres, strict=True):
        fields = "\t".join("" if np.isnan(value) else f"{value:.5f}" for value in row)
        lines.append(f"{number}\t{time:.6f}\t{fields}")
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", errors="backslashreplace")


def is_rewritable(data: bytes) -> bool:
    """Return whether a TRC file has single tabs, decimal points and no wide characters, as `rewrite_trc` expects."""
    lines = data.replace(b"\r", b"\n").split(b"\n")
    rows = [line.split(b"\t") for line in lines if line[:1].isdigit()]
    doubled = bool(rows) and not any(map(bytes.strip, rows[-1][1::2]))
    return b"\x00" not in data and len(rows[-1:] and rows[-1]) > 1 and not doubled and b"," not in b"".join(rows[-1])


def rewrite_trc(data: bytes, where: str, positions_m: Array, changed: Mask) -> bytes:
    """Return a TRC file's bytes with the positions (F, M, 3) that the mask (F, M) marks as changed."""
    text = data.decode("utf-8", errors="surrogateescape")
    parts = re.split("(\r\n|\r|\n)", text)  # lines and line ends alternate
    lines = parts[::2]
    metres = metres_of(_header(lines, where).get("units", "mm"), where)
    values, decimals = positions_m / metres, 5 if metres < 0.1 else 8
    rows = [i for i, line in enumerate(lines) if i >= 5 and line.strip() and line.split("\t")[0].strip()]
    for row, positions, new in zip(rows, values, changed, strict=True):
        if not new.any():
            continue
        fields = lines[row].split("\t")
        fields += [""] * (2 + 3 * len(new) - len(fields))
        for marker in np.flatnonzero(new):
            fields[2 + 3 * marker : 5 + 3 * marker] = [f"{value:.{decimals}f}" for value in positions[marker]]
        parts[2 * row] = "\t".join(fields)
    return "".join(parts).encode("utf-8", errors="surrogateescape")
