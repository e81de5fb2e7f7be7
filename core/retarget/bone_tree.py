"""Bones of an armature, or joints of a file, as a tree with rest positions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..geometry.arrays import Array, IntArray


@dataclass(frozen=True)
class BoneTree:
    """Names, hierarchy and rest positions of bones, parents first.

    Args:
        names: Unique bone names (B).
        parents: Index (B,) of the parent bone, -1 for none.
        heads: Starts (B, 3) of the bones, in any unit.
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
        """Return the bone and its ancestors, nearest first."""
        found = [bone]
        while self.parents[found[-1]] >= 0:
            found.append(int(self.parents[found[-1]]))
        return found

    def is_above(self, upper: int, lower: int) -> bool:
        """Return whether `upper` is `lower` or one of its ancestors."""
        return upper in self.line(lower)

    def shared_ancestor(self, bones: list[int]) -> int:
        """Return the lowest common ancestor of bones (which may be one of them), or -1 if there is none."""
        lines = [self.line(bone) for bone in bones]
        return next((bone for bone in lines[0] if all(bone in line for line in lines[1:])), -1)

    def path(self, upper: int, lower: int) -> list[int]:
        """Return the bones from `upper` down to `lower`, empty if `upper` is not an ancestor."""
        line = self.line(lower)
        return line[: line.index(upper) + 1][::-1] if upper in line else []

    def distances(self, chain: list[int]) -> Array:
        """Return the distance of each bone of a chain from the first one, along the chain."""
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.heads[chain], axis=0), axis=1))))
