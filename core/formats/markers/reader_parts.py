"""Common parts of the readers of marker takes."""

from collections.abc import Iterable, Sequence

import numpy as np

from ...errors import FormatError, TakeError
from ...geometry.arrays import Array
from ...markers.frame_rate import frame_rate
from ...markers.marker_take import MarkerTake
from ...system.files import SLACK_BYTES
from ..unique_names import unique_names

# metres of the units that marker files name
LENGTHS: dict[str, float] = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "mete": 1.0,
    "cm": 0.01, "centimeter": 0.01, "centimeters": 0.01, "centimetres": 0.01,
    "mm": 0.001, "millimeter": 0.001, "millimeters": 0.001, "millimetres": 0.001, "millimetre": 0.001,
    "in": 0.0254, "inch": 0.0254, "inches": 0.0254, "ft": 0.3048, "feet": 0.3048, "dm": 0.1, "um": 1e-6,
}  # fmt: skip
_MOST_FRAMES = 1e9  # that a header may declare; more is no count


def frame_count(declared: float) -> int:
    """Return a frame count that a header declares, 0 where it is none."""
    return int(declared) if 0.0 < declared < _MOST_FRAMES else 0


def metres_of(unit: str, where: str) -> float:
    """Return the metres of a named unit; FormatError when it is unknown."""
    try:
        return LENGTHS[unit.strip().lower()]
    except KeyError:
        raise FormatError(f"has the unknown unit of length {unit.strip()[:20]!r}", where=where) from None


def table_of(rows: Iterable[tuple[Sequence[str], str]], count: int, width: int, size: int, where: str) -> Array:
    """Return the numbers of rows of fields, each with its place; rows may end early.

    Args:
        count: number of rows at most.
        size: bytes of the file, which a few names in its header must not blow up.
    """
    if count * width * 8 > 4 * size + SLACK_BYTES // 2:  # the other half is for the rows of fields
        advice = "export it again, without columns that are empty"
        raise FormatError(
            f"declares {count} rows of {width} columns, far more than it holds", where=where, advice=advice
        )
    table, row = np.empty((count, width)), 0  # of a row that does not come, nothing is written: it takes no memory
    for fields, place in rows:
        values = numbers_of(fields[:width], place)
        table[row, : len(values)], table[row, len(values) :] = values, np.nan
        row += 1
    if row == 0:
        raise FormatError("has no frames", where=where)
    return table[:row]


def numbers_of(fields: Sequence[str], where: str) -> list[float]:
    """Return the numbers of text fields, NaN for blank fields and "nan"."""
    try:
        return [float(field) if field and not field.isspace() else np.nan for field in fields]
    except ValueError as error:
        raise FormatError(f"has a field that is no number ({error})", where=where) from None


def make_take(
    where: str, name: str, fps: float, names: Sequence[str], positions_m: Array,
    frame_numbers: Array | None = None, times_s: Array | None = None,
) -> MarkerTake:  # fmt: skip
    """Return a take; infinite positions and the very origin count as missing.

    Points at the very origin are missing ones too: many systems write zeros for them.
    """
    seen = np.all(np.isfinite(positions_m), axis=-1) & np.any(positions_m != 0.0, axis=-1)
    positions_m = np.where(seen[..., None], positions_m, np.nan)
    frames = np.arange(len(positions_m))
    if frame_numbers is not None and np.all(np.isfinite(frame_numbers)):
        frames = frame_numbers.astype(np.int64)
    has_times = times_s is not None and bool(np.all(np.isfinite(times_s)))
    times = np.asarray(times_s, dtype=np.float64) if has_times else frames / max(fps, 1e-9)
    try:
        return MarkerTake(
            name, fps, unique_names([name.strip() or "unnamed" for name in names]), positions_m, frames, times
        )
    except TakeError as error:
        raise FormatError(error.what, where=where, advice=error.advice) from error


def rate_from_times(times_s: Array) -> float:
    """Return the frame rate of equally spaced times, NaN when there is none."""
    try:
        return frame_rate(times_s)
    except TakeError:
        return float("nan")
