"""The one place where the product's space meets Blender's.

The product: metres, x to the performer's left, y up, z forward; quaternions (w, x, y, z) relative to a rest pose in
which every joint's axes are aligned with the world's. Blender: Z up, characters face -Y; a pose bone's rotation is
relative to its rest matrix, whose columns follow the bone and its roll. Pure numpy: nothing of Blender is imported.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.body.skeleton import Skeleton, forward_kinematics
from ...core.errors import CharacterError
from ...core.geometry import rotations as rot
from ...core.retarget.character_rest_pose import facing

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

BLENDER_FROM_PRODUCT: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])

# Limb segments whose direction in the rig's rest pose may differ from the product's (A pose, legs together), with the
# joint they point at. Spine, clavicles and feet keep the rig's own shape: there a difference is posture or an ankle's
# height, and soles are flat in either rest pose.
_ALIGNED = {"femur": "tibia", "tibia": "foot", "humerus": "radius", "radius": "wrist", "wrist": "hand"}
_FOLLOWING = ("hand", "fingers", "thumb")  # turned along with the forearm
_LEG = (("femur", "tibia"), ("tibia", "foot"))


def points_to_blender(points_m: ArrayLike) -> Array:
    """Return product points or vectors (..., 3) in Blender's axes: (x, -z, y)."""
    return np.asarray(points_m, dtype=np.float64) @ BLENDER_FROM_PRODUCT.T


@dataclass(frozen=True)
class RigRest:
    """What of a rig's rest pose matters for posing it, in the order of the skeleton's joints.

    Args:
        heads: (J, 3) bone heads in the armature's own space and unit.
        axes: (J, 3, 3) armature-from-bone rest rotations (columns: the bone's axes).
        ancestors: (J,) the nearest product joint above each bone from which it inherits rotation, -1 if there is none.
        root_location_is_local: the root bone's location is measured in its rest axes (Blender's default).
    """

    heads: Array
    axes: Array
    ancestors: IntArray
    root_location_is_local: bool = True

    def __post_init__(self) -> None:
        count = len(self.ancestors)
        if self.heads.shape != (count, 3) or self.axes.shape != (count, 3, 3):
            raise CharacterError(f"rest pose of {count} bones has arrays {self.heads.shape}, {self.axes.shape}")


class PoseMap:
    """Turns product poses into a rig's bone rotations and root location.

    With the armature-from-product rotation m, the rest axes R_j and the rotation A_j that brings the rig's bone to the
    product's rest direction, a bone in the world pose G_j stands at m G_j m^-1 A_j R_j, so the rotation that Blender
    wants is (m^-1 A_p R_j)^-1 L_j (m^-1 A_j R_j) with L_j the joint's rotation relative to its ancestor p: one linear
    map of four numbers per joint, computed here once.

    Raises:
        CharacterError: bones lie on top of each other, so the rig's proportions cannot be read.
    """

    def __init__(self, skeleton: Skeleton, rest: RigRest) -> None:
        self._skeleton = skeleton
        self._ancestors = rest.ancestors
        self._same_tree = bool(np.array_equal(rest.ancestors, skeleton.parents))
        self.armature_from_product = _facing(skeleton, rest.heads)
        self.units_per_metre = _scale(skeleton, rest.heads)
        self._maps = self._joint_maps(rest)
        self._root_head = rest.heads[0]
        self._root_axes = rest.axes[0].T if rest.root_location_is_local else np.eye(3)

    def _joint_maps(self, rest: RigRest) -> Array:
        """Return (J, 4, 4): bone quaternion = map @ product quaternion."""
        product_from_armature = rot.conjugate(rot.from_matrix(self.armature_from_product))
        rest_axes = rot.from_matrix(rest.axes)
        alignment = _alignments(self._skeleton, rest.heads, self.armature_from_product)
        above = np.where(self._ancestors[:, None] >= 0, alignment[self._ancestors], rot.identity())
        left = rot.conjugate(rot.multiply(product_from_armature, rot.multiply(above, rest_axes)))
        right = rot.multiply(product_from_armature, rot.multiply(alignment, rest_axes))
        basis = np.eye(4)[None]
        columns = rot.multiply(rot.multiply(left[:, None], basis), right[:, None])
        return np.ascontiguousarray(np.swapaxes(columns, -1, -2))

    def bone_rotations(self, rotations: ArrayLike) -> Array:
        """Return pose bone quaternions (..., J, 4) of product rotations (..., J, 4)."""
        q = np.asarray(rotations, dtype=np.float64)
        if not self._same_tree:
            q = self._relative_to_ancestors(q)
        return np.matmul(self._maps, q[..., None])[..., 0]

    def root_location(self, root_position_m: ArrayLike) -> Array:
        """Return the root pose bone's location (..., 3) for product root positions (..., 3)."""
        scaled = self.units_per_metre * np.asarray(root_position_m, dtype=np.float64)
        return (scaled @ self.armature_from_product.T - self._root_head) @ self._root_axes.T

    def _relative_to_ancestors(self, rotations: Array) -> Array:
        _, world = forward_kinematics(self._skeleton, rotations, np.zeros((*rotations.shape[:-2], 3)))
        above = np.where((self._ancestors >= 0)[:, None], world[..., self._ancestors, :], rot.identity())
        return rot.multiply(rot.conjugate(above), world)


def _facing(skeleton: Skeleton, heads: Array) -> Array:
    """Return the armature-from-product rotation (3, 3): which way the rig stands and looks in its own space."""

    def head(name: str) -> Array:
        found: Array = heads[skeleton.index(name)]
        return found

    left = head("lfemur") - head("rfemur") + head("lhumerus") - head("rhumerus")
    up = head("upperneck") - 0.5 * (head("lfemur") + head("rfemur"))
    return facing(left, up)


def _scale(skeleton: Skeleton, heads: Array) -> float:
    """Return armature units per product metre: the ratio of leg lengths, so that a step covers a step."""
    rig, own = 0.0, 0.0
    rest = skeleton.rest_positions_m
    for side, (upper, lower) in product("lr", _LEG):
        start, end = skeleton.index(side + upper), skeleton.index(side + lower)
        rig += float(np.linalg.norm(heads[end] - heads[start]))
        own += float(np.linalg.norm(rest[end] - rest[start]))
    if rig <= 0.0 or own <= 0.0:
        raise CharacterError("the legs have no length", advice="check the bones' positions in edit mode")
    return rig / own


def _alignments(skeleton: Skeleton, heads: Array, armature_from_product: Array) -> Array:
    """Return A_j (J, 4) in armature space: the shortest turns from the rig's rest directions to the product's."""
    rest = skeleton.rest_positions_m @ armature_from_product.T
    result = rot.identity((len(skeleton),))
    for joint, name in enumerate(skeleton.names):
        base, parent = name[1:], skeleton.parents[joint]
        if base in _FOLLOWING:
            result[joint] = result[parent]
        elif base in _ALIGNED:
            end = skeleton.index(name[0] + _ALIGNED[base])
            start = result[parent] if base in ("tibia", "radius", "wrist") else rot.identity()
            rig_direction, wanted = rot.rotate(start, heads[end] - heads[joint]), rest[end] - rest[joint]
            if min(np.linalg.norm(rig_direction), np.linalg.norm(wanted)) < 1e-9:
                result[joint] = start
                continue
            result[joint] = rot.multiply(rot.between(rig_direction, wanted), start)
    return result
