"""Marker takes as CSV: exports of OptiTrack's Motive, and a plain table.

Our own table: comment lines with "#", one of them with "fps=..."; a header `frame,time_s,NAME_x,NAME_y,NAME_z,...`;
then one row a frame in metres, blank where a marker is missing.
"""

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...errors import FormatError
from ...geometry.arrays import Array
from ...markers.marker_take import MarkerTake
from ...system.files import atomic_path, read_bytes
from .reader_parts import make_take, metres_of, numbers_of, rate_from_times, table_of

_COLUMN = re.compile(r"(?P<name>.+?)[ _.:]?(?P<axis>[xyzXYZ])")
# Motive's kinds of columns, best first: measured before modelled
_MOTIVE_KINDS = ("marker", "bone marker", "rigid body marker")


def read_csv(path: Path | str) -> MarkerTake:
    """Return the take of a CSV file in metres; see the module for the layouts.

    Raises:
        FormatError: not a marker take, or damaged; names file and line.
    """
    where = str(path)
    text = read_bytes(path).decode("utf-8-sig", errors="replace")
    if "\x00" in text:
        raise FormatError("is not a text file", where=where)
    try:
        rows = list(csv.reader(text.splitlines()))
    except csv.Error as error:
        raise FormatError(f"is not CSV ({error})", where=where) from error
    if rows and rows[0] and rows[0][0].strip() == "Format Version":
        return _motive(rows, where)
    return _plain(rows, where)


def _motive(rows: list[list[str]], where: str) -> MarkerTake:
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    labels = {row[1].strip().lower(): row for row in rows[1:8] if len(row) > 1 and not row[0].strip()}
    head = next((i for i, row in enumerate(rows[:12]) if row and row[0].strip() == "Frame"), None)
    if head is None or "type" not in labels or "name" not in labels:
        raise FormatError("lacks the header rows of a Motive export", where=where)
    kinds = [kind.strip().lower() for kind in labels["type"]]
    measures = [cell.strip().lower() for cell in rows[head - 1]]
    axes = [cell.strip().upper() for cell in rows[head]]
    kind = next((kind for kind in _MOTIVE_KINDS if kind in kinds), None)
    if kind is None:
        raise FormatError("has no markers", where=where, advice="export with markers from Motive")
    starts = [
        i for i in range(len(axes) - 2)
        if axes[i : i + 3] == ["X", "Y", "Z"] and kinds[i : i + 1] == [kind] and measures[i : i + 1] == ["position"]
    ]  # fmt: skip
    table = _table(rows, head + 1, len(axes), where)
    positions = np.stack([table[:, i : i + 3] for i in starts], axis=1) * metres_of(
        facts.get("Length Units", "Meters"), where
    )
    rate = facts.get("Export Frame Rate") or facts.get("Capture Frame Rate") or "nan"
    fps = numbers_of([rate], f"{where}, line 1")[0]
    fps = fps if fps > 0.0 else rate_from_times(table[:, 1])
    names = [labels["name"][i] for i in starts]
    own = [name.split(":")[-1] for name in names]  # without the subject, unless several of them have a "Marker1"
    names = own if len(set(own)) == len(own) else names
    return make_take(where, facts.get("Take Name") or Path(where).stem, fps, names, positions, table[:, 0], table[:, 1])


def _plain(rows: list[list[str]], where: str) -> MarkerTake:
    comments = [",".join(row) for row in rows if row and row[0].startswith("#")]
    head = next((i for i, row in enumerate(rows) if any(cell.strip() for cell in row) and row[0][:1] != "#"), None)
    if head is None:
        raise FormatError("is empty", where=where)
    header = [cell.strip() for cell in rows[head]]
    matches = [_COLUMN.fullmatch(cell) for cell in header]
    starts = [i for i in range(len(header) - 2) if _is_triple(matches[i : i + 3])]
    if not starts:
        raise FormatError(
            "is not a marker take", where=f"{where}, line {head + 1}",
            advice="columns must be frame,time_s,NAME_x,NAME_y,NAME_z,... in metres",
        )  # fmt: skip
    table = _table(rows, head + 1, len(header), where)
    lower = [cell.lower() for cell in header]
    frames = table[:, lower.index("frame")] if "frame" in lower else None
    times = next((table[:, lower.index(key)] for key in ("time_s", "time") if key in lower), None)
    stated = re.search(r"fps\s*=\s*([0-9.eE+-]+)", "\n".join(comments))
    fps = numbers_of([stated[1]], where)[0] if stated else float("nan")
    if not fps > 0.0 and times is not None:
        fps = rate_from_times(times)
    if not fps > 0.0:
        raise FormatError("gives neither fps nor times", where=where, advice="add a line '# fps=60' or a column time_s")
    names = [match["name"] for i in starts if (match := matches[i])]
    positions = np.stack([table[:, i : i + 3] for i in starts], axis=1)
    return make_take(where, Path(where).stem, fps, names, positions, frames, times)


def _is_triple(matches: list[re.Match[str] | None]) -> bool:
    found = [match for match in matches if match]
    axes = "".join(match["axis"].lower() for match in found)
    return axes == "xyz" and len({match["name"] for match in found}) == 1


def _table(rows: list[list[str]], start: int, width: int, where: str) -> Array:
    size = sum(len(cell) + 1 for row in rows for cell in row)
    return table_of(_fields(rows, start, width, where), len(rows), width, size, where)


def _fields(rows: list[list[str]], start: int, width: int, where: str) -> Iterator[tuple[list[str], str]]:
    for number, row in enumerate(rows[start:], start=start + 1):
        if not any(cell.strip() for cell in row) or row[0].startswith("#"):
            continue
        if len(row) > width and any(cell.strip() for cell in row[width:]):
            raise FormatError(f"has more than {width} fields", where=f"{where}, line {number}")
        yield row, f"{where}, line {number}"


def write_csv(take: MarkerTake, path: Path | str) -> None:
    """Write a take as our own table, metres to a micrometre."""
    header = ["frame", "time_s", *(f"{name}_{axis}" for name in take.names for axis in "xyz")]
    with (
        atomic_path(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file,
    ):
        file.write(f"# marker take of perfanim, metres, fps={take.fps!r}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        rows = take.positions_m.reshape(take.frames, -1)
        for number, time, row in zip(take.frame_numbers, take.times_s, rows, strict=True):
            fields = ["" if np.isnan(value) else f"{value:.6f}" for value in row]
            writer.writerow([str(int(number)), f"{time:.6f}", *fields])
