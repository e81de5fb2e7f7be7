"""Motion of the product's skeleton onto a character: the rotations of its bones and the way of its hips.

Each bone that stands for a joint takes the joint's orientation in the world, through the alignment of the rest poses;
bones of the trunk and the neck between two such bones take what lies between, by their place along the chain. The
hips go as far as the performer's by the ratio of leg lengths, and the legs are bent (two-bone inverse kinematics, in
the knee's own plane) until the balls of the feet are where the performer's are, so that what stands still there
stands still here, whatever the proportions; hips come down where a leg is too short for that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from ..body.skeleton import Skeleton
from ..geometry import quaternion_components as c
from ..geometry import rotations as rot
from .armature_rest import ArmatureRest, Array, IntArray
from .bone_map import BoneMap
from .character_rest_pose import align_character
from .driven_bones import DrivenBone, driven_ancestors, driven_bones, root_bone
from .leg_ik import Legs

_IDENTITY = rot.identity()

# the matrix of a quaternion's multiplication from the left, (w, x, y, z) placed and signed
_LEFT_INDEX = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_LEFT_SIGN = np.array([[1.0, -1.0, -1.0, -1.0], [1.0, 1.0, -1.0, 1.0], [1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, 1.0]])


class RootMotion(Enum):
    """What carries the character through the room."""

    HIPS = "hips"
    ROOT_BONE = "root bone"
    OBJECT = "object"


@dataclass(frozen=True)
class CharacterPose:
    """What is set on the character; the leading shape is that of the motion.

    Args:
        rotations: (..., N, 4) rotation of each of the `Retargeter.bones` relative to its rest pose, as Blender has it.
        locations: (..., L, 3) location of each of the `Retargeter.located` bones relative to its rest pose. Hips that
            are held by the bone above are moved by that.
        object_rotation: (..., 4), object_location: (..., 3): how the object moves in its own space, in the
            armature's unit; None unless the object carries the motion.
    """

    rotations: Array
    locations: Array
    object_rotation: Array | None
    object_location: Array | None


class Retargeter:
    """Turns poses of a performer into those of a character.

    Args:
        skeleton: the performer's.
        rest: the character's armature.
        bone_map: which bone is which joint.
        root_motion: what carries the character through the room; a root bone is the topmost bone above the hips, and
            where there is none, the hips carry it.
        ancestors: (B,) for each bone the bone whose rotation it follows, -1 for none; where constraints let it follow
            another than its parent. By default the parents.

    Raises:
        CharacterError: the character's rest pose cannot be read.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        rest: ArmatureRest,
        bone_map: BoneMap,
        root_motion: RootMotion = RootMotion.HIPS,
        ancestors: IntArray | None = None,
    ) -> None:
        self.skeleton = skeleton
        self.joints = {joint: rest.index[bone] for joint, bone in bone_map.bones.items()}
        self.alignment = align_character(skeleton, rest, self.joints)
        self._hips = self.joints["root"]
        self.root_motion = root_motion
        self._root_bone = root_bone(rest, self._hips) if root_motion is RootMotion.ROOT_BONE else -1
        if root_motion is RootMotion.ROOT_BONE and self._root_bone < 0:
            self.root_motion = RootMotion.HIPS
        driven = driven_bones(skeleton, rest, self.joints, self.alignment.turns)
        self._order = [entry.bone for entry in driven]
        self._first = np.array([entry.first for entry in driven])
        self._second = np.array([entry.second for entry in driven])
        self._share = np.array([entry.share for entry in driven])[:, None]
        self._between = np.flatnonzero(self._share[:, 0] > 0.0)
        self._place = {bone: place for place, bone in enumerate(self._order)}
        axes = rot.from_matrix(self.alignment.armature_from_product.T @ rest.axes)
        self._rest_axes = axes
        self._ancestors = driven_ancestors(rest, self._order, ancestors)
        self._free = np.flatnonzero(self._ancestors < 0)
        self._jumps = _jumps(skeleton.parents)
        self._maps = self._bone_maps(driven)
        self._legs = Legs(skeleton, self.alignment, self.joints, self._place)
        self._prepare_forearms()
        self._prepare_root(rest)
        carrier = (rest.names[self._root_bone],) if self._root_bone >= 0 else ()
        self.driven = tuple(rest.names[bone] for bone in self._order)
        self.bones = self.driven + carrier
        self.located = (rest.names[self._mover], *carrier) if self._mover != self._root_bone else carrier

    def _bone_maps(self, driven: Sequence[DrivenBone]) -> Array:
        """Return (N, 4, 4): the bone's quaternion = map @ quaternion of its joint relative to its ancestor's.

        A bone stands at D C in the product's axes, with D what turns it and C = A R, the alignment A of its rest pose
        and its rest axes R. Blender wants R^-1 R_p (D_p C_p)^-1 (D C), with p the ancestor: (R^-1 R_p C_p^-1) (D_p^-1
        D) C, linear in the middle factor.
        """
        own = rot.multiply(np.array([entry.turn for entry in driven]), self._rest_axes[self._order])
        left = rot.conjugate(self._rest_axes[self._order])
        has = self._ancestors >= 0
        bones = np.array(self._order)[self._ancestors[has]]
        left[has] = rot.multiply(
            left[has], rot.multiply(self._rest_axes[bones], rot.conjugate(own[self._ancestors[has]]))
        )
        basis = np.eye(4)[None]
        columns = rot.multiply(rot.multiply(left[:, None], basis), own[:, None])
        return np.ascontiguousarray(np.swapaxes(columns, -1, -2))

    def _prepare_forearms(self) -> None:
        self._forearms: list[tuple[int, int, c.Vector]] = []
        for side in "lr":
            if side + "wrist" not in self.joints and {side + "radius", side + "hand"} <= self.joints.keys():
                way = self.skeleton.offsets_m[self.skeleton.index(side + "wrist")]
                forearm, hand = (self._place[self.joints[side + name]] for name in ("radius", "hand"))
                self._forearms.append((forearm, hand, c.unit(c.components(way))))

    def _prepare_root(self, rest: ArmatureRest) -> None:
        def location_axes(bone: int) -> Array:
            return rest.axes[bone].T if rest.local_location[bone] else np.eye(3)

        self._mover = rest.mover(self._hips)
        self._mover_axes, self._hips_head = location_axes(self._mover), rest.heads[self._hips]
        if self._root_bone >= 0:
            self._root_axes, self._root_head = location_axes(self._root_bone), rest.heads[self._root_bone]
            self._root_rotation = rot.from_matrix(rest.axes[self._root_bone])

    def pose(self, rotations: ArrayLike, root_positions_m: ArrayLike) -> CharacterPose:
        """Return the character's pose, of one frame or of many.

        Args:
            rotations: (J, 4) or (F, J, 4) parent-from-joint quaternions relative to rest.
            root_positions_m: (3,) or (F, 3) root in product space, metres.
        """
        world = self._world_rotations(np.asarray(rotations, dtype=np.float64))
        turned = world[..., self._first, :]
        if len(self._between):
            turned[..., self._between, :] = _between(
                turned[..., self._between, :], world[..., self._second[self._between], :], self._share[self._between]
            )
        root: c.Quaternion = c.components(world[..., 0, :])
        position: c.Vector = c.components(np.asarray(root_positions_m, dtype=np.float64))
        hips_m = self._legs.bend(world, root, position, turned)
        for forearm, hand, way in self._forearms:
            _turn_forearm(turned, forearm, hand, way)
        return self._as_blender(turned, root, hips_m)

    def _world_rotations(self, local: Array) -> Array:
        """Return (..., J, 4) world-from-joint quaternions: products along stretches of its line that double."""
        matrices = np.empty((*local.shape[:-2], len(self.skeleton) + 1, 4, 4))
        np.multiply(local[..., _LEFT_INDEX], _LEFT_SIGN, out=matrices[..., :-1, :, :])
        matrices[..., -1, :, :] = np.eye(4)
        for above in self._jumps:
            matrices = np.matmul(matrices[..., above, :, :], matrices)
        return matrices[..., :-1, :, 0]

    def _as_blender(self, turned: Array, root: c.Quaternion, hips_m: c.Vector) -> CharacterPose:
        above = turned[..., self._ancestors, :]
        above[..., self._free, :] = _IDENTITY
        heading = _heading(root) if self.root_motion is not RootMotion.HIPS else None
        if heading is not None:
            above[..., self._place[self._hips], :] = c.stacked(heading)
        relative = np.matmul(np.swapaxes(above[..., _LEFT_INDEX] * _LEFT_SIGN, -1, -2), turned[..., None])
        bones = np.matmul(self._maps, relative)[..., 0]
        scale = self.alignment.units_per_metre
        hips = scale * c.stacked(hips_m) @ self.alignment.armature_from_product.T
        if heading is None:
            return CharacterPose(bones, ((hips - self._hips_head) @ self._mover_axes.T)[..., None, :], None, None)
        turn = _in_axes(c.stacked(heading), self.alignment.armature_from_product)
        way = hips - rot.rotate(turn, self._hips_head)
        up = self.alignment.armature_from_product[:, 1]
        carried = way - (way @ up)[..., None] * up  # what stays upright is left to the hips
        from_rest = rot.rotate(rot.conjugate(turn), hips - carried) - self._hips_head
        locations = (from_rest @ self._mover_axes.T)[..., None, :]
        if self.root_motion is RootMotion.OBJECT:
            return CharacterPose(bones, locations, turn, carried)
        axes = rot.conjugate(self._root_rotation)
        root_turn = rot.multiply(rot.multiply(axes, turn), self._root_rotation)
        moved = rot.rotate(turn, self._root_head) + carried - self._root_head
        bones = np.concatenate((bones, root_turn[..., None, :]), axis=-2)
        if self._mover == self._root_bone:
            locations = ((moved + rot.rotate(turn, from_rest)) @ self._root_axes.T)[..., None, :]
        else:
            locations = np.concatenate((locations, (moved @ self._root_axes.T)[..., None, :]), axis=-2)
        return CharacterPose(bones, locations, None, None)


def _turn_forearm(turned: Array, forearm: int, hand: int, way: c.Vector) -> None:
    """Turn a forearm half as far about itself as its hand: skin is not wrung where there is no wrist bone."""
    turn = c.components(turned[..., forearm, :])
    w, x, y, z = c.multiply(c.conjugate(turn), c.components(turned[..., hand, :]))
    along = x * way[0] + y * way[1] + z * way[2]
    size = (w * w + along * along + 1e-18) ** 0.5
    # half of the twist (w, along); q and -q are one rotation: the one with w > 0 is the shorter
    share = w / (abs(w) + 1e-18) * along / size
    half = c.unit_quaternion((abs(w) / size + 1.0, share * way[0], share * way[1], share * way[2]))
    turned[..., forearm, :] = c.stacked(c.multiply(turn, half))


def _between(first: Array, second: Array, share: Array) -> Array:
    """Return rotations a share of the way between two (normalised sum: never far from the arc for a spine's turns)."""
    sign = np.where(np.sum(first * second, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    mixed = (1.0 - share) * first + share * sign * second
    return mixed / np.sqrt(np.sum(mixed * mixed, axis=-1, keepdims=True))


def _heading(turn: c.Quaternion) -> c.Quaternion:
    """Return the part of a rotation that is about the vertical."""
    w, _, y, _ = c.unit_quaternion((turn[0], 0.0 * turn[0], turn[2], 0.0 * turn[0]))
    return w, 0.0 * w, y, 0.0 * w


def _in_axes(quaternions: Array, matrix: Array) -> Array:
    """Return rotations told in other axes."""
    return np.concatenate((quaternions[..., :1], quaternions[..., 1:] @ matrix.T), axis=-1)


def _jumps(parents: IntArray) -> list[IntArray]:
    """Return for doubling distances which joint lies that far above each; past the root, and for it, the last place.

    With M_j a joint's own rotation, M_j <- M_above(j) M_j for each in turn makes M_j the product along its whole line.
    """
    count = len(parents)
    above = np.append(np.where(parents < 0, count, parents), count)
    found = []
    while np.any(above < count):
        found.append(above)
        above = above[above]
    return found
