"""Hierarchy of BVH files: joints, and the columns of their channels."""

import math
import re
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from ...body.skeleton import MOST_JOINTS
from ...errors import FormatError
from ...geometry.arrays import Array, IntArray
from ..unique_names import unique_names

_CHANNELS = frozenset(axis + kind for axis in "xyz" for kind in ("position", "rotation"))
_END_SITE = -2  # marks an end site on the stack of open braces


@dataclass(frozen=True)
class BvhTurns:
    """Joints with the same order of rotation channels.

    Args:
        joints: Joint indices (N,).
        columns: Columns (N, length of the order) of their channels in a row of the motion.
    """

    order: str
    joints: IntArray
    columns: IntArray


@dataclass(frozen=True)
class BvhHierarchy:
    """Joints of a BVH file in its units; shared between readers, so its arrays must not be changed.

    Args:
        width: Number of channels of all joints.
        orders: Rotation channels (J,) in the file's order, e.g. "ZXY".
        places: Column, joint and axis (P, 3) of each position channel.
    """

    names: tuple[str, ...]
    parents: IntArray
    offsets: Array
    tips: Array
    width: int
    orders: tuple[str, ...]
    turns: tuple[BvhTurns, ...]
    places: IntArray


def read_hierarchy(text: str, where: str) -> BvhHierarchy:
    """Return a file's hierarchy; FormatError names file and line."""
    try:
        return _hierarchy(text)
    except FormatError as error:
        raise FormatError(
            error.what, where=f"{where}, {error.where}", advice="repair this line, or export it again"
        ) from None


@lru_cache(maxsize=16)  # the clips of a data set share only a few hierarchies
def _hierarchy(text: str) -> BvhHierarchy:
    joints = _HierarchyParser().parse(text)
    channels = [(joint, channel) for joint, each in enumerate(joints) for channel in each.channels]
    orders = ["".join(c[0].upper() for c in joint.channels if c.endswith("rotation")) for joint in joints]
    columns: list[list[int]] = [[] for _ in joints]
    places = []
    for column, (joint, channel) in enumerate(channels):
        if channel.endswith("rotation"):
            columns[joint].append(column)
        else:
            places.append((column, joint, "xyz".index(channel[0])))
    turns = []
    for order in sorted(set(orders) - {""}):
        same = [joint for joint, own in enumerate(orders) if own == order]
        turns.append(BvhTurns(order, np.array(same), np.array([columns[joint] for joint in same])))
    return BvhHierarchy(
        names=unique_names([joint.name for joint in joints]),
        parents=np.array([joint.parent for joint in joints], dtype=np.int64),
        offsets=np.array([joint.offset for joint in joints]),
        tips=np.array([joint.tip for joint in joints]),
        width=len(channels),
        orders=tuple(orders),
        turns=tuple(turns),
        places=np.array(places, dtype=np.int64).reshape(-1, 3),
    )


@dataclass
class _Joint:
    name: str
    parent: int
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    tip: tuple[float, ...] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)


class _HierarchyParser:
    def __init__(self) -> None:
        self.joints: list[_Joint] = []
        self.stack: list[int] = []  # joints and end sites with open braces
        self.number = 0  # line number

    def _error(self, what: str) -> FormatError:
        return FormatError(what, where=f"line {self.number}")

    def parse(self, text: str) -> list[_Joint]:
        declared: int | None = None  # joint or end site whose brace comes next
        for self.number, line in enumerate(text.split("\n"), start=1):
            for words in map(str.split, re.split("([{}])", line)):
                if words == ["{"]:
                    if declared is None:
                        raise self._error("has a '{' that does not belong to a joint")
                    self.stack.append(declared)
                    declared = None
                elif words == ["}"]:
                    if not self.stack:
                        raise self._error("closes more joints than it opens")
                    self.stack.pop()
                elif words and words[0].upper() in ("ROOT", "JOINT"):
                    declared = self._add_joint(" ".join(words[1:]))
                elif words and words[0].upper() == "END":
                    if not self.stack or self.stack[-1] == _END_SITE:
                        raise self._error("has an end site outside of a joint")
                    declared = _END_SITE
                elif words:
                    self._facts(words[0], words[1:])
        if self.stack or not self.joints:
            raise self._error("has an incomplete hierarchy")
        return self.joints

    def _add_joint(self, name: str) -> int:
        if not name:
            raise self._error("has a joint without a name")
        if len(self.joints) == MOST_JOINTS:
            raise self._error(f"has more than {MOST_JOINTS} joints")
        parent = self.stack[-1] if self.stack else -1
        if parent == _END_SITE or (parent == -1) != (len(self.joints) == 0):
            raise self._error(f"has the joint {name!r} outside of the root's hierarchy")
        self.joints.append(_Joint(name, parent))
        return len(self.joints) - 1

    def _facts(self, keyword: str, words: list[str]) -> None:
        if keyword.upper() == "OFFSET":
            self._offset(words)
        elif keyword.upper() == "CHANNELS":
            self._channels(words)
        elif keyword.upper() != "HIERARCHY":
            raise self._error(f"has the unknown keyword {keyword[:40]!r}")

    def _offset(self, words: list[str]) -> None:
        try:
            offset = tuple(map(float, words))
        except ValueError:
            raise self._error(f"has an OFFSET that is not a number: {' '.join(words)[:60]}") from None
        if len(offset) != 3 or not all(map(math.isfinite, offset)) or not self.stack:
            raise self._error("needs three finite numbers after OFFSET, inside a joint")
        if self.stack[-1] >= 0:
            self.joints[self.stack[-1]].offset = offset
        else:
            self.joints[self.stack[-2]].tip = offset

    def _channels(self, words: list[str]) -> None:
        channels = [word.lower() for word in words[1:]]
        known = all(channel in _CHANNELS for channel in channels)
        if not words or words[0] != str(len(channels)) or not known or len(set(channels)) != len(channels):
            raise self._error(f"has unknown channels: {' '.join(words)[:80]}")
        if not self.stack or self.stack[-1] < 0:
            raise self._error("has CHANNELS outside of a joint")
        self.joints[self.stack[-1]].channels = channels
