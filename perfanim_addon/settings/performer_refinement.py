"""Refined performer until it is used or discarded, and the offer to refine with the last capture.

Nothing is stored in Blender's data or in files, so a discarded performer leaves no trace.
"""

from dataclasses import dataclass
from pathlib import Path

from ...core.formats.take_file.take_reader import unused_path
from ...core.markers.subject import Subject

ENDING = ".toml"
_ADDED = " refined"  # part of the file's name


@dataclass(frozen=True)
class Refined:
    """A refined performer."""

    take: str  # file of the take that showed the changes
    subject: Subject
    changes: tuple[str, ...]  # changes relative to the performer of the take, in words


@dataclass
class Offer:
    """Current offer."""

    capture: str = ""  # file of the last capture if it can be used to refine the performer, else ""
    refined: Refined | None = None  # refined performer waiting for an answer

    def close(self) -> None:
        """Withdraw the offer."""
        self.capture, self.refined = "", None


offer = Offer()


def command_line(take: str, database: str, result: Path) -> list[str]:
    """Return the command that writes a take's refined first performer to `result`."""
    return ["calibrate", "subject", take, "--refine", take, "--database", database, "--out", str(result)]


def path_beside(old: Path) -> Path:
    """Return an unused file for the refined performer, beside the performer's own."""
    return unused_path(old.parent, old.name.removesuffix(ENDING).partition(_ADDED)[0] + _ADDED, ENDING)


register = unregister = offer.close
