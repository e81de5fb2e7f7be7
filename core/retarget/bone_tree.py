"""Bones of an armature, or joints of a file, as a tree with rest positions."""

from dataclasses import dataclass
from functools import cached_property

from ..geometry.arrays import Array, IntArray


@dataclass(frozen=True)
class BoneTree:
    """Names, hierarchy and rest positions of bones, parents first.

    Args:
        names: (B) bone names.
        parents: (B,) index of the parent bone, -1 without one.
        heads: (B, 3) where the bones begin, any unit.
    """

    names: tuple[str, ...]
    parents: IntArray
    heads: Array

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def index(self) -> dict[str, int]:
        """Bone index by name."""
        return {name: bone for bone, name in enumerate(self.names)}

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the children of each bone."""
        found: list[list[int]] = [[] for _ in self.names]
        for bone, parent in enumerate(self.parents):
            if parent >= 0:
                found[int(parent)].append(bone)
        return tuple(tuple(row) for row in found)

    def line(self, bone: int) -> list[int]:
        """Return the bone and those above it, nearest first."""
        found = [bone]
        while self.parents[found[-1]] >= 0:
            found.append(int(self.parents[found[-1]]))
        return found

    def is_above(self, upper: int, lower: int) -> bool:
        """Tell whether `upper` is `lower` or one of its ancestors."""
        return upper in self.line(lower)

    def shared_ancestor(self, bones: list[int]) -> int:
        """Return the lowest bone above (or among) all the given ones, -1 if none."""
        lines = [self.line(bone) for bone in bones]
        return next((bone for bone in lines[0] if all(bone in line for line in lines[1:])), -1)

    def path(self, upper: int, lower: int) -> list[int]:
        """Return the bones from `upper` down to `lower`, empty if it is not above."""
        line = self.line(lower)
        return line[: line.index(upper) + 1][::-1] if upper in line else []
