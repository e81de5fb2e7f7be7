"""Behaviour and subject of a clip by its file name or description."""

import re
from pathlib import PurePosixPath

_BANDAI = re.compile(r"(?P<set>dataset-\d+)_(?P<kind>[^_]+)_(?P<style>[^_]+)_\d+")


def behaviour_of(name: str, description: str = "") -> str:
    """Return a clip's behaviour.

    That is the description up to its first " - " or comma, or the words of the file name, without numbers. Names
    like "dataset-2_walk-turn-left_active_001" give their second part.
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
    """Return a clip's subject: "14" of "14_02", set and style, or the folder's name."""
    pure = PurePosixPath(name)
    match = _BANDAI.fullmatch(pure.stem)
    if match:
        return f"{match['set']} {match['style']}"
    numbered = re.fullmatch(r"(\d+)_\d+", pure.stem)
    return numbered[1] if numbered else pure.parent.name
