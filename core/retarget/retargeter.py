"""Retargeting a performer's motion to a character with other proportions.

A plan is made once per character and then applied to each pose independently. Each mapped bone takes its joint's world
orientation, corrected by the alignment of the rest poses. Trunk and neck bones between two mapped ones are
interpolated. The hips' travel is scaled by the ratio of leg lengths. Two-bone inverse kinematics puts the feet where
the performer's are, with the soles as high above the floor, so planted feet stay planted; the hips are lowered if a leg
is too short. The floor is the armature's origin, whatever the rest pose stands on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from ..body.skeleton import Skeleton
from ..geometry import quaternion_components as c
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from .armature_rest import ArmatureRest
from .bone_map import BoneMap
from .character_fit import PLAIN_FIT, CharacterFit
from .character_rest_pose import RestAlignment, align_character
from .character_soles import character_heel, character_sole
from .driven_bones import DrivenBone, driven_ancestors, driven_bones, root_bone
from .leg_ik import LegPlan, bend_legs, plan_legs


class RootMotion(Enum):
    """Bone or object that receives the root motion."""

    HIPS = "hips"
    ROOT_BONE = "root bone"
    OBJECT = "object"


@dataclass(frozen=True)
class CharacterPose:
    """Transforms to set on a character; their leading dimensions are those of the motion.

    Args:
        rotations: Rotations (..., N, 4) of `RetargetPlan.bones` relative to the rest pose, as Blender defines them.
        locations: Locations (..., L, 3) of `RetargetPlan.located` relative to the rest pose. Blender ignores
            the location of connected hips, so their nearest unconnected ancestor is located instead.
        object_rotation, object_location: Rotation (..., 4) and location (..., 3) by which the object moves, in armature
            space; None unless the object receives the root motion.
    """

    rotations: Array
    locations: Array
    object_rotation: Array | None
    object_location: Array | None


@dataclass(frozen=True)
class _Blend:
    """Joints that turn the driven bones; bones in `between` are interpolated by `share` towards the second joint."""

    first: IntArray
    second: IntArray
    share: Array
    between: IntArray


@dataclass(frozen=True)
class _RootBone:
    """Rest frame of the root bone, and whether it also moves the hips because they are connected to it."""

    head: Array
    location_axes: Array
    rotation: Array
    moves_hips: bool


@dataclass(frozen=True)
class _Carriers:
    """Rest frames of the bones that move the character, in armature space.

    Args:
        hips: Index of the hips among the driven bones.
        mover_axes: Matrix (3, 3) from a shift in armature space to the location of the bone that moves the hips.
        root: Root bone if it receives the root motion.
    """

    hips: int
    hips_head: Array
    mover_axes: Array
    root: _RootBone | None


@dataclass(frozen=True)
class RetargetPlan:
    """Plan for retargeting from one performer to one character, used by `apply_plan`.

    Args:
        joints: Joint -> index of the character's bone.
        places: Joint -> index of its bone among the driven bones.
        root_motion: Receiver of the root motion; the hips if the armature has no root bone.
        driven: Names of the bones turned by joints.
        bones: Names of all bones turned, in the order of `CharacterPose.rotations`.
        located: Names of the bones moved, in the order of `CharacterPose.locations`.
        is_direct: The bones follow the joints one to one, without inverse kinematics or interpolation.
        adjusted: Indices (A,) of the driven bones that adjustments turn together with what they carry.
        adjustments: Rotations (A, 4) of these bones in their own axes.
    """

    skeleton: Skeleton
    joints: Mapping[str, int]
    places: Mapping[str, int]
    alignment: RestAlignment
    root_motion: RootMotion
    driven: tuple[str, ...]
    bones: tuple[str, ...]
    located: tuple[str, ...]
    is_direct: bool
    blend: _Blend
    ancestors: IntArray
    maps: Array
    legs: LegPlan | None
    forearms: tuple[tuple[int, int, c.Vector], ...]
    carriers: _Carriers
    adjusted: IntArray
    adjustments: Array


def plan_retarget(
    skeleton: Skeleton,
    rest: ArmatureRest,
    bone_map: BoneMap,
    root_motion: RootMotion = RootMotion.HIPS,
    ancestors: IntArray | None = None,
    same_body: bool = False,
    fit: CharacterFit = PLAIN_FIT,
) -> RetargetPlan:
    """Plan the retargeting of a performer's motion onto a character.

    Args:
        root_motion: Desired receiver; the root bone is the topmost bone above the hips.
        ancestors: Bone (B,) that each bone follows, -1 for none; needed if constraints make a bone follow a bone
            other than its parent.
        same_body: The character has the performer's proportions: no inverse kinematics, and hands and feet keep their
            directions.
        fit: Skin of the feet and corrections of each pose; not for `same_body`.

    Raises:
        CharacterError: The character's rest pose is not usable.
    """
    joints = {joint: rest.index[bone] for joint, bone in bone_map.bones.items()}
    alignment = align_character(skeleton, rest, joints, same_body, fit)
    soles = {
        side: character_sole(rest, alignment, joints, side, fit.skins.get(side))
        for side in ("" if same_body else "lr")
        if side + "foot" in joints
    }
    heels = {side: character_heel(alignment, joints, side, fit.skins.get(side), sole) for side, sole in soles.items()}
    root = root_bone(rest, joints["root"]) if root_motion is RootMotion.ROOT_BONE else -1
    if root_motion is RootMotion.ROOT_BONE and root < 0:
        root_motion = RootMotion.HIPS
    driven = driven_bones(skeleton, rest, joints, alignment.turns)
    order = [entry.bone for entry in driven]
    places = {bone: place for place, bone in enumerate(order)}
    follows = driven_ancestors(rest, order, ancestors)
    blend = _blend(driven)
    names = tuple(rest.names[bone] for bone in order)
    mover = rest.mover(joints["root"])
    carrier = (rest.names[root],) if root >= 0 else ()
    limbs = {} if same_body else fit.adjustments.turns(joints)
    return RetargetPlan(
        skeleton=skeleton,
        joints=joints,
        places={joint: places[bone] for joint, bone in joints.items()},
        alignment=alignment,
        root_motion=root_motion,
        driven=names,
        bones=names + carrier,
        located=(rest.names[mover], *carrier) if mover != root else carrier,
        is_direct=same_body and root_motion is RootMotion.HIPS and _follows_joints(skeleton, blend, follows),
        blend=blend,
        ancestors=follows,
        maps=_bone_maps(rest, alignment, driven, follows),
        legs=None
        if same_body
        else plan_legs(skeleton, alignment, joints, places, soles, heels, fit.adjustments.hip_height_m),
        forearms=_forearms(skeleton, joints, places),
        carriers=_carriers(rest, joints["root"], places[joints["root"]], root),
        adjusted=np.array([places[joints[joint]] for joint in limbs], dtype=np.int64),
        adjustments=_in_bone_axes(rest, alignment, joints, limbs),
    )


def apply_plan(plan: RetargetPlan, rotations: ArrayLike, root_positions_m: ArrayLike) -> CharacterPose:
    """Return the character's pose in one frame or in many.

    Args:
        rotations: Local rotations (J, 4) or (F, J, 4).
        root_positions_m: Root positions (3,) or (F, 3) in the world.
    """
    local = np.asarray(rotations, dtype=np.float64)
    positions = np.asarray(root_positions_m, dtype=np.float64)
    if plan.is_direct:
        bones = np.matmul(plan.maps, local[..., plan.blend.first, :, None])[..., 0]
        return _move_hips(plan, bones, _in_armature(plan, positions))
    world = _world_rotations(plan.skeleton, local)
    turned = _turned_bones(plan.blend, world)
    root: c.Quaternion = c.components(world[..., 0, :])
    hips_m: c.Vector = c.components(positions)
    if plan.legs is not None:
        hips_m = bend_legs(plan.legs, world, root, hips_m, turned)
    for forearm, hand, way in plan.forearms:
        _turn_forearm(turned, forearm, hand, way)
    heading = c.stacked(_heading(root)) if plan.root_motion is not RootMotion.HIPS else None
    bones = _blender_rotations(plan, turned, heading)
    hips = _in_armature(plan, c.stacked(hips_m))
    if heading is None:
        return _move_hips(plan, bones, hips)
    in_armature = heading[..., 1:] @ plan.alignment.armature_from_world.T
    turn = np.concatenate((heading[..., :1], in_armature), axis=-1)
    if plan.carriers.root is None:
        return _move_object(plan, bones, hips, turn)
    return _move_root_bone(plan, plan.carriers.root, bones, hips, turn)


def _blend(driven: Sequence[DrivenBone]) -> _Blend:
    share = np.array([entry.share for entry in driven])[:, None]
    first, second = (np.array(joints) for joints in zip(*((d.first, d.second) for d in driven), strict=True))
    return _Blend(first, second, share, np.flatnonzero(share[:, 0] > 0.0))


def _follows_joints(skeleton: Skeleton, blend: _Blend, ancestors: IntArray) -> bool:
    """Return whether each bone belongs to one joint and follows the bone of the joint's parent."""
    above = np.where(ancestors >= 0, blend.first[ancestors], -1)
    return len(blend.between) == 0 and bool(np.array_equal(above, skeleton.parents[blend.first]))


def _bone_maps(
    rest: ArmatureRest, alignment: RestAlignment, driven: Sequence[DrivenBone], ancestors: IntArray
) -> Array:
    """Return maps (N, 4, 4) from the rotation of a joint relative to its ancestor to the rotation of the bone.

    The orientation of a bone in the performer's axes is D C, with the joint's rotation D and C = A R, where A is the
    alignment of its rest pose and R its rest axes. With the ancestor p, the bone's rotation in Blender is
    R^-1 R_p (D_p C_p)^-1 (D C) = (R^-1 R_p C_p^-1) (D_p^-1 D) C, which is linear in the middle factor.
    """
    order = [entry.bone for entry in driven]
    axes = rot.from_matrix(alignment.armature_from_world.T @ rest.axes)
    own = rot.multiply(np.array([entry.turn for entry in driven]), axes[order])
    left = rot.conjugate(axes[order])
    has = ancestors >= 0
    bones = np.array(order)[ancestors[has]]
    left[has] = rot.multiply(left[has], rot.multiply(axes[bones], rot.conjugate(own[ancestors[has]])))
    columns = rot.multiply(rot.multiply(left[:, None], np.eye(4)[None]), own[:, None])
    return np.ascontiguousarray(np.swapaxes(columns, -1, -2))


def _in_bone_axes(
    rest: ArmatureRest, alignment: RestAlignment, joints: Mapping[str, int], turns: Mapping[str, Array]
) -> Array:
    """Return rotations (A, 4) of joints in the standard rest pose in the axes of their bones."""
    found = []
    for joint, turn in turns.items():
        axes = rot.from_matrix(alignment.armature_from_world.T @ rest.axes[joints[joint]])
        own = rot.multiply(alignment.turns[joint], axes)
        found.append(rot.multiply(rot.multiply(rot.conjugate(own), turn), own))
    return np.array(found).reshape(-1, 4)


def _forearms(
    skeleton: Skeleton, joints: Mapping[str, int], places: Mapping[int, int]
) -> tuple[tuple[int, int, c.Vector], ...]:
    """Return indices of forearm and hand, and the forearm's direction, for arms without wrist bones."""
    found = []
    for side in "lr":
        if side + "wrist" not in joints and {side + "radius", side + "hand"} <= joints.keys():
            way = skeleton.offsets_m[skeleton.index(side + "wrist")]
            forearm, hand = (places[joints[side + name]] for name in ("radius", "hand"))
            found.append((forearm, hand, c.unit(c.components(way))))
    return tuple(found)


def _carriers(rest: ArmatureRest, hips: int, place: int, root: int) -> _Carriers:
    def location_axes(bone: int) -> Array:
        axes = rest.axes[bone].T if rest.local_location[bone] else np.eye(3)
        return np.asarray(axes / rest.location_scales[bone])

    mover = rest.mover(hips)
    carrier = None
    if root >= 0:
        carrier = _RootBone(rest.heads[root], location_axes(root), rot.from_matrix(rest.axes[root]), mover == root)
    return _Carriers(place, rest.heads[hips], location_axes(mover), carrier)


def _world_rotations(skeleton: Skeleton, local: Array) -> Array:
    world = local.copy()
    for level in skeleton.levels:
        world[..., level, :] = rot.multiply(world[..., skeleton.parents[level], :], world[..., level, :])
    return world


def _turned_bones(blend: _Blend, world: Array) -> Array:
    """Return world rotations (..., N, 4) of the driven bones relative to rest."""
    turned = world[..., blend.first, :]
    if len(blend.between):
        first, second = turned[..., blend.between, :], world[..., blend.second[blend.between], :]
        turned[..., blend.between, :] = _between(first, second, blend.share[blend.between])
    return turned


def _blender_rotations(plan: RetargetPlan, turned: Array, heading: Array | None) -> Array:
    """Return rotations (..., N, 4) of the bones relative to rest; those of the hips relative to the heading."""
    above = turned[..., plan.ancestors, :]
    above[..., plan.ancestors < 0, :] = rot.identity()
    if heading is not None:
        above[..., plan.carriers.hips, :] = heading
    relative = rot.multiply(rot.conjugate(above), turned)
    bones = np.matmul(plan.maps, relative[..., None])[..., 0]
    if len(plan.adjusted):
        bones[..., plan.adjusted, :] = rot.multiply(bones[..., plan.adjusted, :], plan.adjustments)
    return np.asarray(bones)


def _in_armature(plan: RetargetPlan, positions_m: Array) -> Array:
    scale = plan.alignment.units_per_metre
    return np.asarray(scale * positions_m @ plan.alignment.armature_from_world.T)


def _move_hips(plan: RetargetPlan, bones: Array, hips: Array) -> CharacterPose:
    locations = ((hips - plan.carriers.hips_head) @ plan.carriers.mover_axes.T)[..., None, :]
    return CharacterPose(bones, locations, None, None)


def _move_object(plan: RetargetPlan, bones: Array, hips: Array, turn: Array) -> CharacterPose:
    carried, from_rest = _split_travel(plan, hips, turn)
    locations = (from_rest @ plan.carriers.mover_axes.T)[..., None, :]
    return CharacterPose(bones, locations, turn, carried)


def _move_root_bone(plan: RetargetPlan, root: _RootBone, bones: Array, hips: Array, turn: Array) -> CharacterPose:
    carried, from_rest = _split_travel(plan, hips, turn)
    root_turn = rot.multiply(rot.multiply(rot.conjugate(root.rotation), turn), root.rotation)
    moved = rot.rotate(turn, root.head) + carried - root.head
    bones = np.concatenate((bones, root_turn[..., None, :]), axis=-2)
    if root.moves_hips:
        locations = ((moved + rot.rotate(turn, from_rest)) @ root.location_axes.T)[..., None, :]
    else:
        above = (from_rest @ plan.carriers.mover_axes.T)[..., None, :]
        locations = np.concatenate((above, (moved @ root.location_axes.T)[..., None, :]), axis=-2)
    return CharacterPose(bones, locations, None, None)


def _split_travel(plan: RetargetPlan, hips: Array, turn: Array) -> tuple[Array, Array]:
    """Split the hips' motion into travel along the floor and the remainder, which includes the height."""
    head, up = plan.carriers.hips_head, plan.alignment.armature_from_world[:, 1]
    way = hips - rot.rotate(turn, head)
    carried = way - (way @ up)[..., None] * up
    return carried, rot.rotate(rot.conjugate(turn), hips - carried) - head


def _turn_forearm(turned: Array, forearm: int, hand: int, way: c.Vector) -> None:
    """Turn a forearm by half of its hand's twist, so that the skin is twisted evenly."""
    turn = c.components(turned[..., forearm, :])
    w, x, y, z = c.multiply(c.conjugate(turn), c.components(turned[..., hand, :]))
    along = x * way[0] + y * way[1] + z * way[2]
    size = (w * w + along * along + 1e-18) ** 0.5
    # half of the twist (w, along), the shorter way round
    share = w / (abs(w) + 1e-18) * along / size
    half = c.unit_quaternion((abs(w) / size + 1.0, share * way[0], share * way[1], share * way[2]))
    turned[..., forearm, :] = c.stacked(c.multiply(turn, half))


def _between(first: Array, second: Array, share: Array) -> Array:
    """Return rotations interpolated between two, by normalised sums."""
    sign = np.where(np.sum(first * second, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    mixed = (1.0 - share) * first + share * sign * second
    return mixed / np.sqrt(np.sum(mixed * mixed, axis=-1, keepdims=True))


def _heading(turn: c.Quaternion) -> c.Quaternion:
    """Return the part of a rotation that is about the vertical."""
    w, _, y, _ = c.unit_quaternion((turn[0], 0.0 * turn[0], turn[2], 0.0 * turn[0]))
    return w, 0.0 * w, y, 0.0 * w
