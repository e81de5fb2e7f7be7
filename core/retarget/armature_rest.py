"""Rest pose of an armature, as plain arrays."""

from dataclasses import dataclass

import numpy as np

from ..errors import CharacterError
from ..geometry.arrays import Array, Mask
from .bone_tree import BoneTree


@dataclass(frozen=True)
class ArmatureRest(BoneTree):
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

    def mover(self, bone: int) -> int:
        """Return the nearest bone, itself included, with a location of its own."""
        return next(above for above in self.line(bone) if not self.connected[above] or self.parents[above] < 0)
