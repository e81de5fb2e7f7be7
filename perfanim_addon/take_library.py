"""The user's recorded takes: folder, list, trash."""

import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import bpy

from ..core.errors import TakeError
from ..core.formats.take_file.append_notes import append_notes
from ..core.formats.take_file.take_reader import ENDING, TakeSummary, has_frames, summarise, take_name, unused_path
from ..core.session.pose_filters import FilterSettings
from ..core.system.lock import is_locked
from .preferences.paths import user_folder

RECOVERED_SUFFIX = ".cut"  # suffix of damaged files that were recovered
_DELETED = "deleted"  # name of the trash folder


@dataclass
class _Known:
    """Contents of the folder when it was last read."""

    stamp: int = -1
    takes: list[TakeSummary] = field(default_factory=list)
    bytes: int = 0
    gone: list[Path] = field(default_factory=list)
    gone_bytes: int = 0


_known = _Known()
_unsaved: list[Path] = []  # takes of the open file, which has no name yet


def folder() -> Path:
    """Return the folder of the takes."""
    return user_folder("takes")


def new_path() -> Path:
    """Return an unused file, named after the current time."""
    return unused_path(folder(), datetime.now().astimezone().strftime("%Y-%m-%d %H.%M.%S"))


def listed() -> list[TakeSummary]:
    """Return the takes, newest first, without empty ones and those being recorded.

    Panels call this often, so the folder is read again only after its entries have changed, or after `forget`.
    """
    try:
        stamp = folder().stat().st_mtime_ns
    except OSError:  # the next capture reports the error
        return []
    if stamp != _known.stamp:
        _known.stamp = stamp
        _known.takes = [take for take in _summaries(folder()) if take.complete or _is_cut_off(take.path)]
        _known.bytes, _known.gone = size(take.path for take in _known.takes), in_trash()
        _known.gone_bytes = size(_known.gone)
    return _known.takes


def in_project() -> list[TakeSummary]:
    """Return the takes that were captured, or first put on a character, in the open file; all in an unsaved one."""
    project = bpy.data.filepath
    return [take for take in listed() if not project or take.notes.project == project]


def disk_space() -> tuple[int, int]:
    """Return the size of the listed takes, and of the files in the trash, in bytes."""
    listed()
    return _known.bytes, _known.gone_bytes


def are_deleted() -> bool:
    """Return True if there are deleted takes."""
    listed()
    return any(path.suffix == ENDING for path in _known.gone)


def forget() -> None:
    """Make the next `listed` read the folder again."""
    _known.stamp = -1


def cut_off() -> list[TakeSummary]:
    """Return the takes to offer for recovery, newest first.

    These are takes whose worker died, which have no end mark, and takes that were completed after Blender had ended
    and have not been put on a character yet.
    """
    return [take for take in listed() if not take.complete or (take.orphaned and not take.notes.played)]


def mark_captured(path: Path | str, filters: FilterSettings, recorded: tuple[int, int] | None = None) -> None:
    """Store the filters of a captured take, and its first and last recorded frame if not all are recorded."""
    take = summarise(path)
    notes = replace(take.notes, played=take.notes.played or take.orphaned, project=_project(path))
    append_notes(path, replace(notes, filters=filters.table(), recorded=recorded or take.notes.recorded))
    forget()


def mark_played(path: Path | str, character: str) -> None:
    """Store that a take was put on a character, and end its recovery offer; TakeError if it cannot be written."""
    take = summarise(path)
    project = take.notes.project or _project(path)
    notes = replace(take.notes, played=take.notes.played or take.orphaned, character=character, project=project)
    if notes != take.notes:
        append_notes(path, notes)
        forget()


def _project(path: Path | str) -> str:
    """Return the open file's name for the notes of a take; "" until it is saved, see `claim`."""
    if not bpy.data.filepath:
        _unsaved.append(Path(path))
    return str(bpy.data.filepath)


def claim() -> None:
    """Note the name of the open file, which has just been saved, in the takes that came before."""
    for path in _unsaved:
        with suppress(TakeError):  # it may be deleted meanwhile
            append_notes(path, replace(summarise(path).notes, project=bpy.data.filepath))
    if _unsaved:
        forget()
    disown()


def disown() -> None:
    """Forget the takes of the open file, because another is opened."""
    _unsaved.clear()


def delete(path: Path) -> None:
    """Move a take to the trash; TakeError if it is being recorded or cannot be moved."""
    name = summarise(path).notes.name
    if is_locked(path):
        raise TakeError("is being recorded", where=name, advice="wait for the end of the capture")
    _move(path, folder() / _DELETED)


def deleted() -> list[TakeSummary]:
    """Return the deleted takes, newest first."""
    return _summaries(folder() / _DELETED)


def restore(path: Path) -> None:
    """Move a deleted take back into the list; TakeError if it cannot be moved."""
    _move(path, folder())


def in_trash() -> list[Path]:
    """Return the files in the trash: deleted takes and recovered files."""
    return [*(folder() / _DELETED).glob(f"*{ENDING}"), *folder().glob(f"*{ENDING}{RECOVERED_SUFFIX}")]


def low_rated(days: int, stars: int) -> list[TakeSummary]:
    """Return the complete takes older than `days` with at most `stars` stars."""
    limit = datetime.now(UTC) - timedelta(days=days)
    return [take for take in listed() if take.complete and take.notes.rating <= stars and _created(take) < limit]


def remove(paths: Iterable[Path]) -> int:
    """Remove files permanently and return the bytes freed; TakeError if one cannot be removed."""
    freed = 0
    for path in paths:
        try:
            held = path.stat().st_size
            path.unlink()
        except OSError as error:
            what = f"cannot be removed ({error.strerror})"
            raise TakeError(what, where=str(path), advice="check that you may write to its folder") from error
        finally:
            forget()
        freed += held
    return freed


def size(paths: Iterable[Path]) -> int:
    """Return the total size of files in bytes."""
    return sum(path.stat().st_size for path in paths if path.exists())


def size_text(count: float) -> str:
    """Return a number of bytes with a readable unit."""
    for unit in ("bytes", "KB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"


def _move(path: Path, target: Path) -> None:
    place = unused_path(target, take_name(path))
    try:
        target.mkdir(parents=True, exist_ok=True)
        shutil.move(path, place)
    except OSError as error:
        raise TakeError(
            f"cannot be moved ({error.strerror})", where=str(path), advice="check that you may write to its folder"
        ) from error
    forget()


def _is_cut_off(path: Path) -> bool:
    with suppress(TakeError):
        return has_frames(path) and not is_locked(path)
    return False


def _summaries(where: Path) -> list[TakeSummary]:
    """Return the readable takes in a folder, newest first, without temporary files, whose names begin with a dot."""
    found = []
    for path in sorted(where.glob(f"[!.]*{ENDING}")):
        with suppress(TakeError):
            found.append(summarise(path))
    return sorted(found, key=_created, reverse=True)


def _created(take: TakeSummary) -> datetime:
    """Return the start time of a take, or else the time of its last change."""
    try:
        return datetime.fromisoformat(take.created).astimezone(UTC)
    except ValueError:
        try:
            changed_s = take.path.stat().st_mtime
        except OSError:  # deleted meanwhile
            changed_s = 0.0
        return datetime.fromtimestamp(changed_s, UTC)
