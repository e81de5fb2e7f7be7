"""Reading and writing of marker takes in all formats, in metres."""

from collections.abc import Callable
from pathlib import Path

from ...errors import FormatError
from ...markers.marker_take import MarkerTake, load_take, save_take
from ...markers.steady_take import steady_take
from ..take_file.take_reader import ENDING
from .c3d import read_c3d
from .c3d_write import write_c3d
from .csv_take import read_csv, write_csv
from .keypoint_files import read_npy
from .qualisys_tsv import read_tsv
from .recorded_take import read_recorded_take
from .trc import read_trc, write_trc

_OWN = ".take.npz"
# file extension -> reader
_READERS: dict[str, Callable[[Path], MarkerTake]] = {
    ".c3d": read_c3d,
    ".trc": read_trc,
    ".csv": read_csv,
    ".tsv": read_tsv,
    ".npy": read_npy,
    _OWN: load_take,
    ENDING: read_recorded_take,
}
READABLE = tuple(_READERS)
WRITABLE = (_OWN, ".c3d", ".csv", ".trc")


def is_recorded(path: Path | str) -> bool:
    """Return whether a file name has the extension of recorded takes."""
    return Path(path).name.lower().endswith(ENDING)


def read_take(path: Path | str) -> MarkerTake:
    """Return the marker take in a file, in metres and the file's own axes.

    The extension, one of `READABLE`, determines the format.

    Raises:
        FormatError: The file is of the wrong kind, is damaged, or has no markers.
        TakeError: A .take.npz has an unsupported version, or a recorded take has no poses.
    """
    ending = Path(path).suffix.lower()
    read = _READERS.get(_OWN if ending == ".npz" else ending)
    if read is None:
        raise FormatError("is not a marker take", where=str(path), advice="give one of " + ", ".join(READABLE))
    return read(Path(path))


def check_ending(path: Path | str, endings: tuple[str, ...] = WRITABLE) -> None:
    """Raise FormatError unless a file name has one of the extensions, by default those of `write_take`."""
    if not Path(path).name.lower().endswith(endings):
        raise FormatError(
            "does not have an extension that can be written", where=str(path), advice=f"use one of {', '.join(endings)}"
        )


def write_take(take: MarkerTake, path: Path | str) -> MarkerTake:
    """Write a take and return it as written; the extension, one of `WRITABLE`, determines the format.

    A `.take.npz` stores the times of the frames; the other formats state a rate, at which the frames are resampled.
    """
    check_ending(path)
    ending = next(ending for ending in WRITABLE if Path(path).name.lower().endswith(ending))
    written = take if ending == _OWN else steady_take(take)
    {_OWN: save_take, ".c3d": write_c3d, ".csv": write_csv, ".trc": write_trc}[ending](written, path)
    return written
