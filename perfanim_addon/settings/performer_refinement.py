"""A refined performer until it is used or refused, and the capture's offer.

No Blender data is kept here, and no file: a refused performer leaves nothing behind.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.formats.take_file.take_reader import unused_path
from ...core.markers.subject import Subject

ENDING = ".toml"
_ADDED = " refined"  # to the name of the performer's file


@dataclass(frozen=True)
class Refined:
    """A refined performer.

    Args:
        take: file that it was refined by.
        changes: against the performer of the take, in words.
    """

    take: str
    subject: Subject
    changes: tuple[str, ...]


@dataclass
class _Offer:
    capture: str = ""
    refined: Refined | None = None


_offer = _Offer()


def command_line(take: str, database: str, result: Path) -> list[str]:
    """Return the command that writes a take's refined first performer to `result`."""
    return ["calibrate", "subject", take, "--refine", take, "--database", database, "--out", str(result)]


def offer_capture(take: str) -> None:
    """Offer the refinement by the take of the last capture, "" for none of it."""
    _offer.capture = take


def captured() -> str:
    """Return the take of the last capture while it offers a refinement, "" without."""
    return _offer.capture


def keep_refined(take: str, subject: Subject, changes: Sequence[str]) -> None:
    """Keep a refined performer until it is used or refused."""
    _offer.refined = Refined(take, subject, tuple(changes))


def refined() -> Refined | None:
    """Return the refined performer that waits for an answer."""
    return _offer.refined


def close() -> None:
    """End the offer: it was answered, or there is nothing to change."""
    _offer.capture, _offer.refined = "", None


def path_beside(old: Path) -> Path:
    """Return an unused file beside a performer's for the refined one."""
    return unused_path(old.parent, old.name.removesuffix(ENDING).partition(_ADDED)[0] + _ADDED, ENDING)


def register() -> None:
    """Begin without an offer."""
    close()


def unregister() -> None:
    """Undo `register`."""
    close()
