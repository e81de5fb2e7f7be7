"""Hierarchy of BVH files: joints, and the columns of their channels."""

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from ...body.skeleton import MOST_JOINTS
from ...errors import FormatError
from ...geometry.arrays import Array, IntArray
from ..unique_names import unique_names

_CHANNELS = frozenset(axis + kind for axis in "xyz" for kind in ("position", "rotation"))
_KNOWN = 16  # hierarchies that are kept: the clips of a data set share a few


@dataclass(frozen=True)
class BvhTurns:
    """Joints with the same order of rotation channels.

    Args:
        joints: (N,) of them.
        columns: (N, length of the order) of their channels in a row.
    """

    order: str
    joints: IntArray
    columns: IntArray


@dataclass(frozen=True)
class BvhHierarchy:
    """Joints of a BVH file in its units, none of its arrays to be changed.

    Args:
        width: channels of all joints.
        orders: (J) rotation channels in the file's order, e.g. "ZXY".
        places: (P, 3) column, joint and axis of each position channel.
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
    except _DamageError as error:
        what, line = error.args
        raise FormatError(what, where=f"{where}, line {line}", advice="the file is damaged") from None


@lru_cache(maxsize=_KNOWN)
def _hierarchy(text: str) -> BvhHierarchy:
    joints = _HierarchyParser(text).parse()
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


class _DamageError(Exception):
    """Damage: a text, and its line."""


@dataclass
class _Joint:
    name: str
    parent: int
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    tip: tuple[float, ...] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)


class _HierarchyParser:
    def __init__(self, text: str) -> None:
        self.lines = text.replace("{", "\n{\x01").replace("}", "\n\x01}").split("\n")
        self.joints: list[_Joint] = []
        self.stack: list[int] = []
        self.number = 0

    def _error(self, what: str) -> _DamageError:
        return _DamageError(what, self.number)

    def parse(self) -> list[_Joint]:
        opened: int | None = None
        end_site = -2  # on the stack in place of a joint
        self.number = 1
        first = True
        for piece in self.lines:
            # braces were given lines of their own, marked so that they do not count
            own_line = "\x01" in piece
            self.number += 0 if first or own_line else 1
            first = False
            brace, text = ("{", piece[2:]) if piece.startswith("{\x01") else ("", piece)
            if brace:
                if opened is None:
                    raise self._error("has a '{' that belongs to no joint")
                self.stack.append(opened)
                opened = None
            if text.startswith("\x01}"):
                if not self.stack:
                    raise self._error("closes more joints than it opens")
                self.stack.pop()
                text = text[2:]
            words = text.split()
            if not words:
                continue
            keyword = words[0].upper()
            if keyword in ("ROOT", "JOINT"):
                opened = self._open(" ".join(words[1:]))
            elif keyword == "END":
                if not self.stack or self.stack[-1] == end_site:
                    raise self._error("has an end site outside of a joint")
                opened = end_site
            elif keyword == "OFFSET":
                self._offset(words[1:])
            elif keyword == "CHANNELS":
                self._channels(words[1:])
            elif keyword != "HIERARCHY":
                raise self._error(f"has the unknown keyword {words[0][:40]!r}")
        if self.stack or not self.joints:
            raise self._error("has a hierarchy that is not complete")
        return self.joints

    def _open(self, name: str) -> int:
        if not name:
            raise self._error("has a joint without a name")
        if len(self.joints) == MOST_JOINTS:
            raise self._error(f"has more than {MOST_JOINTS} joints")
        parent = self.stack[-1] if self.stack else -1
        if parent == -2 or (parent == -1) != (len(self.joints) == 0):
            raise self._error(f"has the joint {name!r} outside of the root's hierarchy")
        self.joints.append(_Joint(name, parent))
        return len(self.joints) - 1

    def _offset(self, words: list[str]) -> None:
        try:
            offset = tuple(map(float, words))
        except ValueError:
            raise self._error(f"has an OFFSET that is no number: {' '.join(words)[:60]}") from None
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
