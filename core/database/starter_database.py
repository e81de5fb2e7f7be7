"""The starter database: the shipped motion, built once for each user and version."""

import os
import sys
from pathlib import Path

from .. import __version__
from ..errors import DatabaseError
from ..system.assets import MOTION
from ..system.progress import Progress, no_progress
from .build_database import build_database
from .store import DATABASE_SUFFIX


def starter_database(progress: Progress = no_progress) -> Path:
    """Return the database of the shipped motion, which is used where none is named.

    The first call builds it in the user's folder for cached files, within seconds.

    Raises:
        DatabaseError: It cannot be built or written.
    """
    path = _cache_folder() / f"starter-{__version__}{DATABASE_SUFFIX}"
    if not path.exists():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            what = f"the starter database cannot be written ({error.strerror})"
            raise DatabaseError(what, where=str(path.parent), advice="name another motion database") from error
        build_database([MOTION], path, progress=lambda share, _: progress(share, "building the starter database"))
    return path


def _cache_folder() -> Path:
    """Return the folder for files that can be made again, by the custom of the system."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "perfanim"
