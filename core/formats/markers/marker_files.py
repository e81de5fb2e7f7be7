"""Marker takes in the formats of other programs and in our own, all in metres."""

from pathlib import Path

from ...errors import FormatError
from ...markers.marker_take import MarkerTake, load_take, save_take
from ..take_file.reading import ENDING
from . import c3d, qualisys_tsv, trc
from .c3d import read_c3d
from .c3d_write import write_c3d
from .csv_take import read_csv, write_csv
from .qualisys_tsv import read_tsv
from .recorded_take import read_recorded_take
from .trc import read_trc, write_trc

READABLE = (".c3d", ".trc", ".csv", ".tsv", ".take.npz", ENDING)
WRITABLE = (".take.npz", ".c3d", ".csv", ".trc")


def is_recorded(path: Path | str) -> bool:
    """Return whether a file name is that of a recorded take."""
    return Path(path).name.lower().endswith(ENDING)


def read_take(path: Path | str) -> MarkerTake:
    """Return the marker take of a file; its extension chooses the format.

    Positions are metres in the file's own axes, NaN where missing. Readable: `READABLE`.

    Raises:
        FormatError: another kind of file, damaged, or without markers.
        TakeError: a .take.npz of another version, or a recorded take without poses.
    """
    path = Path(path)
    name = path.name.lower()
    if name.endswith(".npz"):
        return load_take(path)
    readers = {".c3d": read_c3d, ".trc": read_trc, ".csv": read_csv, ".tsv": read_tsv, ENDING: read_recorded_take}
    if path.suffix.lower() not in readers:
        raise FormatError("is no marker take", where=str(path), advice="give one of " + ", ".join(READABLE))
    return readers[path.suffix.lower()](path)


def declared_frames(path: Path | str) -> int:
    """Return the frame count in the header of a file, 0 if its format has none."""
    counters = {".c3d": c3d.declared_frames, ".trc": trc.declared_frames, ".tsv": qualisys_tsv.declared_frames}
    count = counters.get(Path(path).suffix.lower())
    return count(path) if count else 0


def check_ending(path: Path | str, endings: tuple[str, ...] = WRITABLE) -> None:
    """Raise FormatError for a file name with another ending; default `write_take`'s."""
    if not Path(path).name.lower().endswith(endings):
        raise FormatError("has an ending that cannot be written", where=str(path), advice=f"use {', '.join(endings)}")


def write_take(take: MarkerTake, path: Path | str) -> None:
    """Write a take; the file name's ending chooses the format.

    Raises:
        FormatError: an ending that cannot be written, or the folder cannot be.
    """
    check_ending(path)
    for ending, write in ((".take.npz", save_take), (".c3d", write_c3d), (".csv", write_csv), (".trc", write_trc)):
        if Path(path).name.lower().endswith(ending):
            write(take, path)
            return
