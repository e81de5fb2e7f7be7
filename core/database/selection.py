"""Selection of motion files by name and behaviour."""

import fnmatch
from collections.abc import Sequence
from pathlib import PurePosixPath

from ..errors import DatabaseError
from ..formats.motion.motion_sources import MotionFile
from .labels import behaviour_of


def select_files(files: Sequence[MotionFile], include: Sequence[str], exclude: Sequence[str]) -> list[MotionFile]:
    """Return the files that globs include and none excludes; no `include` means all.

    A glob may fit the whole name, the file name, the stem or the behaviour.

    Raises:
        DatabaseError: a glob of `include` fits no file.
    """
    for pattern in include:
        if files and not any(_fits(file, (pattern,)) for file in files):
            behaviours = sorted({behaviour_of(file.name, file.description) for file in files})
            listed = ", ".join(behaviours[:20]) + (", ..." if len(behaviours) > 20 else "")
            raise DatabaseError(
                f"no file name and no behaviour fits {pattern!r}", where="include", advice=f"behaviours: {listed}"
            )
    return [file for file in files if (not include or _fits(file, include)) and not _fits(file, exclude)]


def _fits(file: MotionFile, patterns: Sequence[str]) -> bool:
    pure = PurePosixPath(file.name)
    texts = (file.name, pure.name, pure.stem, behaviour_of(file.name, file.description))
    return any(fnmatch.fnmatch(text, pattern) for text in texts for pattern in patterns)
