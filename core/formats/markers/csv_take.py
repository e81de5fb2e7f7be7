"""Marker takes in CSV files: exports from OptiTrack Motive, FreeMoCap tables, and our own table.

Our own table: comment lines with "#", one of them with "fps=..."; a header `frame,time_s,NAME_x,NAME_y,NAME_z,...`;
then one row per frame in metres, blank where a marker is missing.

FreeMoCap's: the same columns in millimetres, without a rate, or a row per frame and point (`frame,keypoint,x,y,z,...`).
"""

import csv
import io
import re
from collections.abc import Container, Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ...body.clock import seconds_of
from ...errors import FormatError
from ...geometry.arrays import Array
from ...markers.marker_take import MarkerTake
from ...system.file_content import decode_text
from ...system.files import atomic_path, is_over_budget, read_bytes
from .keypoint_files import are_keypoints, keypoint_take
from .reader_parts import (
    SECONDS,
    make_take,
    metres_of,
    numbers_of,
    separator_of,
    table_of,
)

# FreeMoCap tables with one row per point: their columns, and the model and trajectory to read
_LONG, _BODY_MODEL, _POSITIONS = frozenset(("frame", "keypoint", "x", "y", "z")), "body", "3d_xyz"
_BY_CAMERA = "timestamp_by_camera"

_BLANK: list[str] = []  # one list for all blank lines, to save memory
_COLUMN = re.compile(r"(?P<name>.+?)[ _.:]?(?P<axis>[xyzXYZ])")
_NUMBER = re.compile(r"frame", re.IGNORECASE)
_CLOCK = re.compile(
    r"time(?P<stamp>_?stamps?)?[ _]*[\[(]?(?P<unit>s|ms|us|µs|ns|(milli|micro|nano)?seconds)?[\])]?", re.IGNORECASE
)
# Motive's kinds of columns; measured positions are preferred to modelled ones
_MOTIVE_KINDS = ("marker", "bone marker", "rigid body marker")


def read_csv(path: Path | str) -> MarkerTake:
    """Return the take in a CSV file, in metres; the module lists the layouts, and FormatError names file and line."""
    where = str(path)
    text = decode_text(read_bytes(path), where, "table of markers")
    if "\x00" in text:
        raise FormatError("is not a text file", where=where, advice="export it as CSV")
    separator = _separator(text)
    try:
        rows = [row or _BLANK for row in csv.reader(io.StringIO(text, newline=None), delimiter=separator)]
    except csv.Error as error:
        raise FormatError(f"is not CSV ({error})", where=where, advice="export it as CSV") from error
    if rows and rows[0] and rows[0][0].strip() == "Format Version":
        return _motive(rows, where)
    return _plain(rows, where)


def _separator(text: str) -> str:
    """Return the field separator, found in the first line that is not blank or a comment."""
    first = next((line for line in text.splitlines() if line.strip() and line[:1] != "#"), "")
    return separator_of(first) or ","


def _motive(rows: list[list[str]], where: str) -> MarkerTake:
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    labels = {row[1].strip().lower(): row for row in rows[1:8] if len(row) > 1 and not row[0].strip()}
    head = next((i for i, row in enumerate(rows[:12]) if row and row[0].strip() == "Frame"), None)
    if head is None or "type" not in labels or "name" not in labels:
        raise FormatError("lacks the header rows of a Motive export", where=where, advice="export it with the header")
    kinds = [kind.strip().lower() for kind in labels["type"]]
    measures = [cell.strip().lower() for cell in rows[head - 1]]
    axes = [cell.strip().upper() for cell in rows[head]]
    kind = next((kind for kind in _MOTIVE_KINDS if kind in kinds), None)
    if kind is None:
        raise FormatError("has no markers", where=where, advice="export it from Motive with markers")
    starts = [
        i for i in range(len(axes) - 2)
        if axes[i : i + 3] == ["X", "Y", "Z"] and kinds[i : i + 1] == [kind] and measures[i : i + 1] == ["position"]
    ]  # fmt: skip
    table = _table(rows, head + 1, len(axes), where, range(len(axes)))
    positions = table[:, np.array(starts, dtype=np.int64)[:, None] + np.arange(3)]
    positions *= metres_of(facts.get("Length Units", "Meters"), where)
    rate = facts.get("Export Frame Rate") or facts.get("Capture Frame Rate") or "nan"
    fps = numbers_of([rate], f"{where}, line 1")[0]
    names = [labels["name"][i] for i in starts]
    # the subject's name is dropped unless two subjects share a marker name
    own = [name.split(":")[-1] for name in names]
    names = own if len(set(own)) == len(own) else names
    count = facts.get("Total Exported Frames", "")
    declared = float(count) if count.isdecimal() else 0.0
    take = make_take(where, fps, names, positions, table[:, 0], table[:, 1], declared)
    return replace(take, name=facts.get("Take Name") or take.name)


def _plain(rows: list[list[str]], where: str) -> MarkerTake:
    head = next((i for i, row in enumerate(rows) if any(cell.strip() for cell in row) and row[0][:1] != "#"), None)
    if head is None:
        raise FormatError("is empty", where=where, advice="export it again")
    header = [cell.strip() for cell in rows[head]]
    if {cell.lower() for cell in header} >= _LONG:
        return _long(rows, head, header, where)
    names = {i: name for i in range(len(header) - 2) if (name := _name_of(header[i : i + 3]))}
    if not names:
        raise FormatError(
            "is not a marker take", where=f"{where}, line {head + 1}",
            advice="columns must be frame,time_s,NAME_x,NAME_y,NAME_z,... in metres",
        )  # fmt: skip
    number, clock = (_first_place(pattern, header) for pattern in (_NUMBER, _CLOCK))
    used = {number, clock, *(start + axis for start in names for axis in range(3))}
    rows = rows if clock is None else _with_seconds(rows, clock)
    table = _table(rows, head + 1, len(header), where, used)
    frames = None if number is None else table[:, number]
    times = None if clock is None else _seconds(table[:, clock], header[clock])
    positions = table[:, np.array(list(names))[:, None] + np.arange(3)]
    fps = _stated_fps(rows, where)
    is_timed = fps > 0.0 or (times is not None and bool(np.all(np.isfinite(times))))
    if (not is_timed or _BY_CAMERA in header) and are_keypoints(list(names.values())):
        return keypoint_take(where, list(names.values()), positions, fps, frames, times)
    if not fps > 0.0 and times is None:
        raise FormatError(
            "states neither fps nor times", where=where, advice="add a line '# fps=60' or a column time_s"
        )
    return make_take(where, fps, list(names.values()), positions, frames, times)


def _long(rows: list[list[str]], head: int, header: list[str], where: str) -> MarkerTake:
    """Return the take of a table with one row per frame and point; other models than the body's are left out."""
    places = {cell.lower(): place for place, cell in enumerate(header)}
    used = [places[key] for key in ("frame", "x", "y", "z")]
    model, trajectory, clock, keypoint = (places.get(key) for key in ("model", "trajectory", "timestamp", "keypoint"))
    body, size = _BODY_MODEL in {_cell(row, model)[-len(_BODY_MODEL) :] for row in rows[head + 1 :]}, 0
    numbers, names = [], []
    stamps: dict[float, str] = {}
    for number, row in enumerate(rows[head + 1 :], start=head + 2):
        size += sum(map(len, row))
        is_other = body and not _cell(row, model).endswith(_BODY_MODEL)
        if not row or is_other or _cell(row, trajectory) not in ("", _POSITIONS):
            continue
        numbers.append(numbers_of([_cell(row, place) for place in used], f"{where}, line {number}"))
        names.append(_cell(row, keypoint))
        if clock is not None:
            stamps.setdefault(numbers[-1][0], _cell(row, clock))
    if not numbers:
        raise FormatError("has no frames", where=where, advice="export it again")
    values = np.array(numbers)
    frames, at = np.unique(values[:, 0], return_inverse=True)
    labels = list(dict.fromkeys(names))
    if is_over_budget(24 * len(frames) * len(labels), size) or not np.all(np.isfinite(frames)):
        what = "lacks frame numbers, or most points in most frames"
        raise FormatError(what, where=where, advice="export it again with all points")
    points = np.full((len(frames), len(labels), 3), np.nan)
    column = {label: place for place, label in enumerate(labels)}
    points[at, [column[name] for name in names]] = values[:, 1:]
    times = None
    if clock is not None:
        seconds = numbers_of([_date_seconds(stamps[frame]) for frame in frames], where)
        times = _seconds(np.array(seconds), "timestamp")
    return keypoint_take(where, labels, points, float("nan"), frames, times)


def _cell(row: list[str], place: int | None) -> str:
    """Return a field of a row, or "" beyond its end."""
    return row[place].strip() if place is not None and place < len(row) else ""


def _stated_fps(rows: list[list[str]], where: str) -> float:
    """Return the rate in a comment line, or NaN."""
    comments = "\n".join(",".join(row) for row in rows if row and row[0].startswith("#"))
    stated = re.search(r"fps\s*=\s*([0-9.eE+-]+)", comments)
    return numbers_of([stated[1]], where)[0] if stated else float("nan")


def _with_seconds(rows: list[list[str]], clock: int) -> list[list[str]]:
    """Return the rows with a column's dates converted to seconds."""
    return [[*row[:clock], _date_seconds(row[clock]), *row[clock + 1 :]] if len(row) > clock else row for row in rows]


def _date_seconds(cell: str) -> str:
    """Return a date and time of day in seconds, UTC unless a zone is named; other fields are returned unchanged."""
    if ":" not in cell:
        return cell
    with suppress(ValueError):
        date = datetime.fromisoformat(cell.strip())
        return repr((date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp())
    return cell


def _first_place(pattern: re.Pattern[str], header: list[str]) -> int | None:
    """Return the first column whose name matches, or None."""
    return next((place for place, cell in enumerate(header) if pattern.fullmatch(cell)), None)


def _seconds(times: Array, name: str) -> Array:
    """Return a column of times in seconds; the unit is in its name, or, for "timestamp", is found from the steps."""
    match = _CLOCK.fullmatch(name)
    unit = (match["unit"] or "").lower() if match else ""
    if match and match["stamp"] and not unit:
        return seconds_of(times)
    factor = SECONDS.get(unit[:-7] if unit.endswith("seconds") else unit, 1.0)
    return times if factor == 1.0 else (times - times[0]) * factor


def _name_of(cells: list[str]) -> str:
    """Return the name shared by x, y and z columns, or "" for other columns."""
    if "".join(cell[-1:] for cell in cells).lower() != "xyz":
        return ""
    found = {match["name"] for cell in cells if (match := _COLUMN.fullmatch(cell))}
    return found.pop() if len(found) == 1 else ""


def _table(rows: list[list[str]], start: int, width: int, where: str, used: Container[int | None]) -> Array:
    """Return the numbers (F, width) in the columns that are used, and NaN in the others, which may contain text."""
    size = sum(len(cell) + 1 for row in rows for cell in row)
    return table_of(_fields(rows, start, width, where, used), len(rows), width, size, where)


def _fields(
    rows: list[list[str]], start: int, width: int, where: str, used: Container[int | None]
) -> Iterator[tuple[list[str], str]]:
    for number, row in enumerate(rows[start:], start=start + 1):
        if not any(cell.strip() for cell in row) or row[0].startswith("#"):
            continue
        if len(row) > width and any(cell.strip() for cell in row[width:]):
            place, advice = f"{where}, line {number}", "remove the fields without a heading, or export it again"
            raise FormatError(f"has more than {width} fields", where=place, advice=advice)
        yield [cell if place in used else "" for place, cell in enumerate(row)], f"{where}, line {number}"


def write_csv(take: MarkerTake, path: Path | str) -> None:
    """Write a take as our own table, in metres with micrometre resolution."""
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
