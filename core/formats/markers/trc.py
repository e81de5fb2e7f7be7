"""TRC marker trajectories (Motion Analysis, OpenSim)."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...errors import FormatError
from ...geometry.arrays import Array, Mask
from ...markers.marker_take import MarkerTake
from ...system.files import atomic_path, read_bytes
from .reader_parts import frame_count, lines_of, make_take, metres_of, table_of


def read_trc(path: Path | str) -> MarkerTake:
    """Return the take of a TRC file in metres.

    Blank fields, every spelling of NaN and points at the very origin are missing positions; rows may end early. Points
    without a name are ignored. If the data rate is zero, the times give it.

    Raises:
        FormatError: The file is not TRC, is damaged, or has no markers; names file and line.
    """
    where, data = str(path), read_bytes(path)
    lines = lines_of(data)
    if not lines[0].lower().startswith("pathfiletype"):
        raise FormatError("is not a TRC file (it does not begin with PathFileType)", where=where)
    if len(lines) < 5:
        raise FormatError("ends within its header", where=f"{where}, line {len(lines)}", advice="the file is cut off")
    header = _header(lines, where)
    names = _names(lines[3], header, where)
    width = 2 + 3 * len(names)
    rows = table_of(_rows(lines, width, where), len(lines), width, len(data), where)
    positions = rows[:, 2:].reshape(len(rows), len(names), 3) * metres_of(header.get("units", "mm"), where)
    return make_take(where, _number(header.get("datarate", "")), names, positions, rows[:, 0], rows[:, 1])


def declared_frames(path: Path | str) -> int:
    """Return the frame count in a TRC header, 0 if it is left open; errors as in `read_trc`."""
    return frame_count(_number(_header(lines_of(read_bytes(path)), str(path)).get("numframes", "")))


def _header(lines: list[str], where: str) -> dict[str, str]:
    if len(lines) < 3:
        raise FormatError("ends within its header", where=where)
    keys, values = lines[1].split("\t"), lines[2].split("\t")
    header = {k.strip().lower(): v.strip() for k, v in zip(keys, values, strict=False)}
    if "units" not in header and "datarate" not in header:
        raise FormatError("has no header values", where=f"{where}, line 3")
    return header


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _names(line: str, header: dict[str, str], where: str) -> list[str]:
    # some writers shift the names by a column against the data, so only their order counts
    names = [field.strip() for field in line.split("\t")[2:] if field.strip()]
    declared = _number(header.get("nummarkers", ""))
    if not names:
        advice = "name the points in the program that wrote it"
        raise FormatError("has no markers with a name", where=f"{where}, line 4", advice=advice)
    if declared < len(names):
        raise FormatError(f"declares {declared:g} markers, names {len(names)}", where=f"{where}, line 4")
    return names


def _rows(lines: list[str], width: int, where: str) -> Iterator[tuple[list[str], str]]:
    for number, line in enumerate(lines[5:], start=6):
        fields = line.split("\t")
        if not fields[0].strip():
            continue
        place = f"{where}, line {number}"
        # Vicon and BTK put points without a name after the named ones; these are ignored
        beyond = len(line.rstrip().split("\t")) - width
        if beyond > 0 and beyond % 3:
            raise FormatError(f"has fields beyond its {width}", where=place)
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


def rewrite_trc(data: bytes, where: str, positions_m: Array, changed: Mask) -> bytes:
    """Return a TRC file's bytes with changed positions, (F, M, 3) and (F, M)."""
    text = data.decode("utf-8", errors="surrogateescape")
    parts = re.split("(\r\n|\r|\n)", text)  # lines and line ends in turn
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
