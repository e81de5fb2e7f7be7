"""Rest pose of an armature as arrays."""

from dataclasses import dataclass

import numpy as np

from ..errors import CharacterError, counted
from ..geometry.arrays import Array, Mask
from .bone_tree import BoneTree


@dataclass(frozen=True)
class ArmatureRest(BoneTree):
    """Bones at rest, parents first, in armature space.

    Args:
        tails: Ends (B, 3) of the bones.
        axes: Armature-from-bone rest rotations (B, 3, 3) (columns: the bone's axes).
        deform: Mask (B,) of bones that move vertices.
        inherits_rotation: Mask (B,) of bones that turn with their parent.
        local_location: Mask (B,) of bones with Local Location, whose location is along their rest axes.
        location_scales: Factors (B,) from a bone's location to armature space: the scale of its ancestors for
            bones with Local Location, else 1.
        connected: Mask (B,) of bones fixed to their parent's end, so that their location has no effect.

    Raises:
        CharacterError: There are no bones, or the arrays do not fit together.
    """

    tails: Array
    axes: Array
    deform: Mask
    inherits_rotation: Mask
    local_location: Mask
    location_scales: Array
    connected: Mask

    def __post_init__(self) -> None:
        count = len(self.names)
        if count == 0:
            raise CharacterError("the armature has no bones", advice="pick the armature that moves the character")
        shapes = [array.shape for array in (self.parents, self.heads, self.tails, self.axes)]
        if shapes != [(count,), (count, 3), (count, 3), (count, 3, 3)]:
            raise CharacterError(
                f"{counted(count, 'bone')} cannot have arrays of shapes {shapes}",
                where="armature",
                advice="give one row per bone",
            )
        if np.any(self.parents >= np.arange(count)):
            raise CharacterError(
                "a parent comes after its child", where="armature", advice="sort the bones so that parents come first"
            )

    def mover(self, bone: int) -> int:
        """Return the bone that moves a bone: itself, or the nearest ancestor with a location of its own."""
        return next(above for above in self.line(bone) if not self.connected[above] or self.parents[above] < 0)
