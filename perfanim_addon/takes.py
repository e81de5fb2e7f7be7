"""The user's recorded takes: where they are, what is in the folder, which were cut off."""

from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

from ..core.errors import TakeError
from ..core.take_file.edit import append_notes
from ..core.take_file.lock import is_locked
from ..core.take_file.reading import ENDING, TakeSummary, has_frames, summarise
from .place import user_folder

SET_ASIDE = ".cut"  # behind the name of a file whose content has been recovered


@dataclass
class _Known:
    """What was found when the folder was last looked into."""

    stamp: int = -1
    takes: list[TakeSummary] = field(default_factory=list)


_known = _Known()


def folder() -> Path:
    """Return the folder of the takes."""
    return user_folder("takes")


def new_path() -> Path:
    """Return a file for a capture that begins now."""
    name = datetime.now().astimezone().strftime("%Y-%m-%d %H.%M.%S")
    path, count = folder() / f"{name}{ENDING}", 2
    while path.exists():
        path, count = folder() / f"{name} ({count}){ENDING}", count + 1
    return path


def listed() -> list[TakeSummary]:
    """Return the takes, the newest first; those that are being recorded, or hold no frame, are left out.

    Panels ask for them often: the folder is looked into only when something was added or removed, or after `forget`.
    """
    try:
        stamp = folder().stat().st_mtime_ns
    except OSError:  # no folder can be made: a capture tells
        return []
    if stamp != _known.stamp:
        _known.stamp, _known.takes = stamp, _found()
    return _known.takes


def forget() -> None:
    """Look into the folder again next time: a take has changed, or a capture has ended."""
    _known.stamp = -1


def cut_off() -> list[TakeSummary]:
    """Return the takes of which nothing may have come, the newest first.

    They have no end mark, as their worker died, or outlived Blender and have not been put onto a character since.
    """
    return [take for take in listed() if not take.complete or (take.orphaned and not take.notes.played)]


def mark_played(path: Path | str) -> None:
    """Note that a take that outlived Blender, or its capture, has been put onto a character; it is offered no more.

    Raises:
        TakeError: it is no take, or cannot be written.
    """
    take = summarise(path)
    if take.orphaned and not take.notes.played:
        append_notes(path, replace(take.notes, played=True))
        forget()


def _found() -> list[TakeSummary]:
    found = []
    for path in sorted(folder().glob(f"*{ENDING}"), reverse=True):
        try:
            take = summarise(path)
            if take.complete or (has_frames(path) and not is_locked(path)):
                found.append(take)
        except TakeError:  # nothing that could be shown, or saved
            continue
    return found
