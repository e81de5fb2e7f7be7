"""Behaviour and subject of a clip, read from its file name, and selection of files by name or behaviour."""

import fnmatch
import re
from collections.abc import Sequence
from pathlib import PurePosixPath

from ..errors import DatabaseError
from ..formats.motion.motion_sources import MotionFile

_BANDAI = re.compile(r"(?P<set>dataset-\d+)_(?P<kind>[^_]+)_(?P<style>[^_]+)_\d+")


def behaviour_of(name: str, description: str = "") -> str:
    """Return a clip's behaviour: the description up to " - " or a comma, or the words of the file name.

    For names like "dataset-2_walk-turn-left_active_001" it is the second part.
    """
    if description:
        return re.split(r" - |,", description)[0].strip().lower()
    stem = PurePosixPath(name).stem
    match = _BANDAI.fullmatch(stem)
    if match:
        return match["kind"].lower()
    words = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", stem).lower())
    return " ".join(words)


def subject_of(name: str) -> str:
    """Return a clip's subject: "14" for "14_02", "SET STYLE" for "SET_MOTION_STYLE_001", or the folder's name."""
    pure = PurePosixPath(name)
    match = _BANDAI.fullmatch(pure.stem)
    if match:
        return f"{match['set']} {match['style']}"
    numbered = re.fullmatch(r"(\d+)_\d+", pure.stem)
    return numbered[1] if numbered else pure.parent.name


def select_files(files: Sequence[MotionFile], include: Sequence[str], exclude: Sequence[str]) -> list[MotionFile]:
    """Return the files that match a glob of `include`, if any are given, and none of `exclude`.

    A glob may match the whole path, the file name, the stem or the behaviour.

    Raises:
        DatabaseError: A glob of `include` matches no file.
    """
    for pattern in include:
        if files and not any(_fits(file, (pattern,)) for file in files):
            behaviours = sorted({behaviour_of(file.name, file.description) for file in files})
            listed = ", ".join(behaviours[:20]) + (", ..." if len(behaviours) > 20 else "")
            raise DatabaseError(
                f"no file name or behaviour matches {pattern!r}",
                where="include",
                advice=f"choose from the behaviours {listed}",
            )
    return [file for file in files if (not include or _fits(file, include)) and not _fits(file, exclude)]


def _fits(file: MotionFile, patterns: Sequence[str]) -> bool:
    pure = PurePosixPath(file.name)
    texts = (file.name, pure.name, pure.stem, behaviour_of(file.name, file.description))
    return any(fnmatch.fnmatch(text, pattern) for text in texts for pattern in patterns)
