"""Hashes of a take's inputs, settings and outputs."""

import hashlib
import json
from pathlib import Path
from typing import Any

from ... import __version__
from ...errors import PerfanimError
from ...formats.markers.marker_files import is_recorded
from ...formats.take_file.take_reader import read_take_file
from ...system.files import is_file, is_folder, open_foreign
from .plan import HOLDS, Holds, TakePlan

_VERSION = 1  # version of a take's outputs; a new one invalidates old records
_BLOCK = 1 << 20


class ContentDigests:
    """SHA-256 digests of files; each file is read once."""

    def __init__(self) -> None:
        self._known: dict[Path, str] = {}

    def of_file(self, path: Path) -> str:
        """Return the digest of a file's bytes, or "" if it cannot be read."""
        if path not in self._known:
            self._known[path] = file_digest(path)
        return self._known[path]

    def of_source(self, source: str) -> list[list[str]]:
        """Return name and digest of each file that a source (file, folder or pattern) names."""
        path = Path(source)
        if is_file(path):
            return [["", self.of_file(path)]]
        folder, pattern = (path, "*") if is_folder(path) else (path.parent, path.name)
        files = sorted(file for file in folder.glob(pattern) if is_file(file))
        return [[file.name, self.of_file(file)] for file in files]


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, or "" if it cannot be read."""
    digest = hashlib.sha256()
    try:
        with open_foreign(path) as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
    except (OSError, PerfanimError):
        return ""
    return digest.hexdigest()


def take_digest(take: TakePlan, contents: ContentDigests) -> str:
    """Return the hash of everything that a take's outputs depend on.

    This is the take's content, the files used to solve it, its settings, and the version of this program.

    The location of the files and the other takes of the batch do not matter.
    """
    facts: dict[str, Any] = {
        "software": __version__,
        "version": _VERSION,
        "name": take.name,
        "options": {key: _content(key, value, contents) for key, value in sorted(take.options.items())},
    }
    if not take.is_tracked:
        facts["take"] = [Path(take.take).suffix.lower(), contents.of_file(Path(take.take))]
        if is_recorded(take.take) and "database" not in take.options:
            facts["database"] = contents.of_file(Path(_recorded_database(take.take)))
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def _content(key: str, value: Any, contents: ContentDigests) -> Any:
    holds = HOLDS.get(key)
    if holds is Holds.FILE or (holds is Holds.NAME_OR_FILE and Path(value).is_absolute()):
        return contents.of_file(Path(value))
    if holds is Holds.SOURCE:
        return contents.of_source(value) if isinstance(value, str) else [contents.of_source(each) for each in value]
    if holds is Holds.CAMERAS:
        parts = [camera.rpartition("=") for camera in value]
        return [[name, contents.of_source(source)] for name, _, source in parts]
    return value


def _recorded_database(path: str) -> str:
    """Return the database that a recorded take was solved with, or "" if unknown."""
    try:
        return str(read_take_file(path).setup.database.get("path", ""))
    except PerfanimError:
        return ""
