"""Functions shared by the readers of marker takes."""

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...body.clock import ClockFault, clock_of, seconds_of
from ...errors import FormatError, TakeError, counted
from ...geometry.arrays import Array, IntArray
from ...markers.marker_take import MarkerTake
from ...system.file_content import decode_text
from ...system.files import is_over_budget
from ..unique_names import unique_names

# metres per unit, by the names used in marker files
LENGTHS: dict[str, float] = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "mete": 1.0,
    "cm": 0.01, "centimeter": 0.01, "centimeters": 0.01, "centimetres": 0.01,
    "mm": 0.001, "millimeter": 0.001, "millimeters": 0.001, "millimetres": 0.001, "millimetre": 0.001,
    "in": 0.0254, "inch": 0.0254, "inches": 0.0254, "ft": 0.3048, "feet": 0.3048, "dm": 0.1, "um": 1e-6,
}  # fmt: skip


def lines_of(data: bytes, where: str, expected: str) -> list[str]:
    """Return the lines of a text file from any system; FormatError if it is of another kind than `expected`."""
    return re.split("\r\n|\r|\n", decode_text(data, where, expected))


def separator_of(line: str) -> str | None:
    """Return the field separator of a line: tab, semicolon or comma; None for spaces."""
    found = max("\t;,", key=line.count)  # the first one wins a tie
    return found if found in line else None


LARGEST_FRAME = 2.0**53  # above this, float64 does not represent every whole number

# seconds per unit of time; "" if a header names no unit
SECONDS = {
    "": 1.0,
    "s": 1.0,
    "ms": 1e-3,
    "milli": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "micro": 1e-6,
    "ns": 1e-9,
    "nano": 1e-9,
}


def metres_of(unit: str, where: str) -> float:
    """Return the metres per named unit; FormatError if it is unknown."""
    try:
        return LENGTHS[unit.strip().lower()]
    except KeyError:
        what = f"has the unknown unit of length {unit.strip()[:20]!r}"
        raise FormatError(what, where=where, advice="export it in millimetres or metres") from None


def table_of(rows: Iterable[tuple[Sequence[str], str]], count: int, width: int, size: int, where: str) -> Array:
    """Return the numbers in rows of fields; rows may end early.

    Args:
        rows: Fields of each row, and its place for messages.
        count: Largest possible number of rows.
        width: Number of columns.
        size: Size of the file in bytes, which limits the table.
    """
    if is_over_budget(2 * count * width * 8, size, 8):  # the rows of fields take as much memory as the numbers
        advice = "export it again, without empty columns"
        raise FormatError(
            f"declares {count} rows of {width} columns, far more than it holds", where=where, advice=advice
        )
    table, row = np.empty((count, width)), 0  # rows that are never written take no memory
    for fields, place in rows:
        values = numbers_of(fields[:width], place)
        table[row, : len(values)], table[row, len(values) :] = values, np.nan
        row += 1
    if row == 0:
        raise FormatError("has no frames", where=where, advice="export it again")
    return table[:row]


def numbers_of(fields: Sequence[str], where: str) -> list[float]:
    """Return the numbers in text fields, NaN for blanks and "nan"; if no field has a point, commas are decimal."""
    try:
        return _numbers(fields)
    except ValueError as error:
        if any("," in field for field in fields) and not any("." in field for field in fields):
            with suppress(ValueError):
                return _numbers([field.replace(",", ".") for field in fields])
        what = f"has a field that is not a number ({error})"
        raise FormatError(what, where=where, advice="correct the field, or export it again") from None


def _numbers(fields: Sequence[str]) -> list[float]:
    return [float(field) if field and not field.isspace() else np.nan for field in fields]


def make_take(
    where: str, fps: float, names: Sequence[str], positions_m: Array,
    frame_numbers: Array | None = None, times_s: Array | None = None, declared: float = 0.0,
) -> MarkerTake:  # fmt: skip
    """Return a take with true times, and with a rate that agrees with them.

    Infinite positions count as missing; so do points exactly at the origin, which many systems write for missing ones.

    Args:
        fps: Rate that the header states; may be zero or negative if there are times.
        times_s: Times (F,), seconds or a smaller unit, as written: they may be rounded or contradict the header.
        declared: Frame count in the header; 0, NaN or an impossible number if there is none.
    """
    seen = np.all(np.isfinite(positions_m), axis=-1) & np.any(positions_m != 0.0, axis=-1)
    positions_m = np.where(seen[..., None], positions_m, np.nan)
    frames = np.arange(len(positions_m))
    if frame_numbers is not None and np.all(np.abs(frame_numbers) <= LARGEST_FRAME):
        frames = frame_numbers.astype(np.int64)
    fps, times, notes = _clock(where, fps, frames, times_s)
    names = unique_names([each.strip() or "unnamed" for each in names])
    lacking = max(int(declared) - len(frames), 0) if 0.0 < declared < 1e9 else 0
    if lacking:
        notes += (f"{Path(where).name} was cut off: it holds {len(frames)} of {declared:.0f} frames",)
    try:
        title = Path(where).stem
        return MarkerTake(title, fps, names, positions_m, frames, times, notes=notes, cut_off_frames=lacking)
    except TakeError as error:
        raise FormatError(error.what, where=where, advice=error.advice) from error


def _clock(
    where: str, stated_fps: float, frames: IntArray, times_s: Array | None
) -> tuple[float, Array, tuple[str, ...]]:
    """Return the rate of a file's frames, their times (F,), and notes about them."""
    stated = stated_fps if stated_fps > 0.0 else None
    if times_s is not None:
        known = seconds_of(np.asarray(times_s, dtype=np.float64), stated)
        with suppress(TakeError):
            clock = clock_of(known, stated, frames)
            stated = clock.fps
            if len(clock.rows) > 1 and np.all(np.isfinite(known)):
                told = tuple(note.text for note in clock.notes if note.kind is ClockFault.HEADER)
                skipped = int(np.ptp(frames)) + 1 - len(frames)
                if clock.is_steady and not clock.lost and skipped and np.ptp(np.diff(frames)):
                    told += (f"the frame numbers skip {counted(skipped, 'frame')}, the times none: the times are used",)
                return clock.fps, clock.times_s if len(clock.rows) == len(frames) else known, told
    if stated is None:
        raise FormatError("states neither a frame rate nor times", where=where, advice="export it with the frame rate")
    text = "the times of its frames are incomplete or all the same: the frame numbers and the rate are used instead"
    return stated, frames / stated, (text,) * (times_s is not None and len(frames) > 1)
