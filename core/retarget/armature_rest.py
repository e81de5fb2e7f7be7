"""Rest pose of an armature, as plain arrays."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import CharacterError
from ..geometry.arrays import Array, IntArray, Mask

IntArray = IntArray


@dataclass(frozen=True)
class ArmatureRest:
    """Bones at rest, parents first, in the armature's own space and unit.

    Args:
        names: (B) bone names, unique.
        parents: (B,) index of the parent bone, -1 without one.
        heads, tails: (B, 3) ends of the bones.
        axes: (B, 3, 3) armature-from-bone rest rotations (columns: the bone's axes).
        deform: (B,) whether the bone moves vertices.
        inherits_rotation: (B,) whether the parent turns the bone.
        local_location: (B,) whether the bone's location is measured in its rest axes.
        connected: (B,) whether the bone is held at its parent's end, where its location counts for nothing.

    Raises:
        CharacterError: no bones, or arrays that do not belong together.
    """

    names: tuple[str, ...]
    parents: IntArray
    heads: Array
    tails: Array
    axes: Array
    deform: Mask
    inherits_rotation: Mask
    local_location: Mask
    connected: Mask

    def __post_init__(self) -> None:
        count = len(self.names)
        if count == 0:
            raise CharacterError("the armature has no bones", advice="pick the armature that moves the character")
        shapes = [array.shape for array in (self.parents, self.heads, self.tails, self.axes)]
        if shapes != [(count,), (count, 3), (count, 3), (count, 3, 3)]:
            raise CharacterError(f"{count} bones cannot have arrays of shapes {shapes}")
        if np.any(self.parents >= np.arange(count)):
            raise CharacterError("parents must come before their children")

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

    def mover(self, bone: int) -> int:
        """Return the nearest bone, itself included, with a location of its own."""
        return next(above for above in self.line(bone) if not self.connected[above] or self.parents[above] < 0)

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
