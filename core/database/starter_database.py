"""The starter database: the shipped motion, built once for each user and version."""

from pathlib import Path

from .. import __version__
from ..errors import DatabaseError
from ..system.assets import MOTION
from ..system.progress import Progress, no_progress
from ..system.user_folder import cache_folder
from .build_database import build_database
from .store import DATABASE_SUFFIX

STARTER = "starter"
"""Name that stands for the starter database wherever a motion database is named."""


def named_database(path: Path | str) -> Path:
    """Return the file of a motion database: the starter database's for its name, if no file has this name."""
    return starter_database() if str(path) == STARTER and not Path(path).exists() else Path(path)


def starter_database(progress: Progress = no_progress) -> Path:
    """Return the path of the shipped motion's database, which is used unless another one is chosen.

    The first call builds the database in the user's cache folder, which takes a few seconds.

    Raises:
        DatabaseError: The database cannot be built or written.
    """
    path = cache_folder() / f"starter-{__version__}{DATABASE_SUFFIX}"
    if not path.exists():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            what = f"the starter database cannot be written ({error.strerror})"
            raise DatabaseError(what, where=str(path.parent), advice="choose another motion database") from error
        build_database([MOTION], path, progress=lambda share, _: progress(share, "building the starter database"))
    return path
