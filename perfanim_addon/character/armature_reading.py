"""Rest pose and effective parents of Blender's armatures, as needed for retargeting.

In control rigs, constraints may make a bone follow a bone other than its parent. These bones are found by trial: each
bone is rotated, and the bones that rotate with it are recorded.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Quaternion
from numpy.typing import ArrayLike

from ...core.errors import CharacterError
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array, IntArray
from ...core.retarget.armature_rest import ArmatureRest

_FK_SWITCH = "IK_FK"  # Rigify's property for a limb: 0 inverse, 1 forward kinematics
_FOLLOW_SWITCHES = ("neck_follow", "head_follow")  # 1: the neck follows the chest, the head the neck
_TRIED = Quaternion((0.3, 0.8, -0.5), 0.7)  # trial rotation
_APPLY = "apply its scale (Object > Apply > Scale), and that of its parent"


@dataclass(frozen=True)
class ArmatureLimits:
    """Tolerances and sizes of armatures."""

    same_rotation_rad: float = 0.02  # largest difference between the rotations of bones that rotate together
    same_scale: float = 0.01  # largest relative difference between the axes of a uniform scale
    same_share: float = 0.003  # largest difference in a bone's share of the leg length for equal proportions
    shortest_bone_m: float = 0.012  # Blender deletes zero-length bones when Edit Mode is left


LIMITS = ArmatureLimits()


def read_armature_rest(armature_object: bpy.types.Object) -> ArmatureRest:
    """Return the rest pose of all bones of an armature object, with their displayed lengths (scale included)."""
    bones = list(armature_object.data.bones)  # Blender keeps parents before their children
    place = {bone.name: index for index, bone in enumerate(bones)}
    count = len(bones)
    parents = np.array([place[bone.parent.name] if bone.parent else -1 for bone in bones], dtype=np.int64)
    heads = np.array([bone.head_local for bone in bones], dtype=np.float64).reshape(count, 3)
    tails = np.array([bone.tail_local for bone in bones], dtype=np.float64).reshape(count, 3)
    scales = _shown_scales(armature_object, parents)
    above = np.where(parents >= 0, scales[parents], 1.0)
    tails = (tails - heads) * scales[:, None]
    steps = (heads - np.where(parents[:, None] >= 0, heads[parents], 0.0)) * above[:, None]
    for index, parent in enumerate(parents):
        heads[index] = steps[index] + (heads[parent] if parent >= 0 else 0.0)
    is_local = np.array([bone.use_local_location for bone in bones], dtype=bool)
    return ArmatureRest(
        names=tuple(place),
        parents=parents,
        heads=heads,
        tails=heads + tails,
        axes=np.array([bone.matrix_local.to_3x3().normalized() for bone in bones], dtype=np.float64).reshape(-1, 3, 3),
        deform=np.array([bone.use_deform for bone in bones], dtype=bool),
        inherits_rotation=np.array([bone.use_inherit_rotation for bone in bones], dtype=bool),
        local_location=is_local,
        location_scales=np.where(is_local, above, 1.0),
        connected=np.array([bone.use_connect for bone in bones], dtype=bool),
    )


def own_scale(bone: bpy.types.PoseBone) -> float:
    """Return the uniform scale of a bone, or 1 if its scale is non-uniform.

    glTF files can scale bones; importers leave this scale in the pose, although it belongs to the rest pose. A
    non-uniform scale is left over from an animation.
    """
    least, most = min(bone.scale), max(bone.scale)
    return float(sum(bone.scale)) / 3.0 if least > 0.0 and most - least <= LIMITS.same_scale * most else 1.0


def _shown_scales(armature_object: bpy.types.Object, parents: IntArray) -> Array:
    """Return the displayed scale (B,) of an armature's bones, inherited scale included."""
    if armature_object.pose is None:  # the object is not in any scene
        return np.ones(len(parents))
    scales = np.array([own_scale(bone) for bone in armature_object.pose.bones], dtype=np.float64)
    for index, (bone, parent) in enumerate(zip(armature_object.data.bones, parents, strict=True)):
        if parent >= 0 and not bone.inherit_scale.startswith("NONE"):
            scales[index] *= scales[parent]
    return scales


def check_scale(armature_object: bpy.types.Object) -> None:
    """Raise CharacterError for an armature with a non-uniform or mirroring scale, its own or a parent's.

    Bones rotate in armature space: with a non-uniform scale, limbs would change their lengths as they rotate. A
    mirrored character would go left when the performer goes right.
    """
    axes = np.array(armature_object.matrix_world.to_3x3(), dtype=np.float64)
    lengths = np.linalg.svd(axes, compute_uv=False)
    name = armature_object.name
    if lengths[0] > (1.0 + LIMITS.same_scale) * lengths[-1]:
        how = f"{lengths[0] / lengths[-1]:.3g} times larger" if lengths[-1] > 0.0 else "flat"
        raise CharacterError(f"has a non-uniform scale, {how} in one direction", where=name, advice=_APPLY)
    if np.linalg.det(axes) < 0.0:
        advice = f"make the scale positive, or {_APPLY}"
        raise CharacterError("a negative scale mirrors it", where=name, advice=advice)


def clear_offsets(armature_object: bpy.types.Object, turned: Iterable[str], moved: Iterable[str]) -> None:
    """Reset the non-uniform scale of rotated bones, and the location of those that are not also moved.

    An earlier animation may have left both.
    """
    kept = set(moved)
    for name in turned:
        bone = armature_object.pose.bones[name]
        bone.scale = (own_scale(bone),) * 3
        if name not in kept:
            bone.location = (0.0, 0.0, 0.0)


def switch_to_fk(armature_object: bpy.types.Object, bones: Sequence[str]) -> None:
    """Make a rig follow the rotations of the given bones.

    Rigify's switches are set to FK, and the bones' IK constraints are muted.
    """
    for bone in armature_object.pose.bones:
        for name in (_FK_SWITCH, *_FOLLOW_SWITCHES):
            if name in bone:
                bone[name] = 1.0
    for name in bones:
        for constraint in armature_object.pose.bones[name].constraints:
            if constraint.type == "IK":
                constraint.mute = True
    armature_object.update_tag()


def is_constrained(armature_object: bpy.types.Object, bones: Sequence[str]) -> bool:
    """Return whether a bone or one of its ancestors has constraints."""
    posed = [armature_object.pose.bones[name] for name in bones]
    return any(len(each.constraints) for bone in posed for each in (bone, *bone.parent_recursive))


def followed_bones(context: bpy.types.Context, armature_object: bpy.types.Object, bones: Sequence[str]) -> IntArray:
    """Return for each bone (B,) of an armature the index of the one among `bones` that rotates it, or -1.

    Parents come before their children. The pose is restored. CharacterError if constraints hold a bone, so that
    rotating it has no effect.
    """
    place = {bone.name: index for index, bone in enumerate(armature_object.data.bones)}
    found = np.full(len(place), -1, dtype=np.int64)
    posed = armature_object.pose.bones
    with _rest_pose(context, armature_object, bones):
        still = _turns(context, armature_object, bones)
        led: list[list[int]] = [[] for _ in bones]
        for index, name in enumerate(bones):
            posed[name].rotation_quaternion = _TRIED
            moved = _turns(context, armature_object, bones)
            posed[name].rotation_quaternion = Quaternion()
            steps = [new @ old.inverted() for new, old in zip(moved, still, strict=True)]
            if abs(steps[index].w) > np.cos(0.25 * _TRIED.angle):
                raise CharacterError(
                    f"constraints hold the bone {name!r}",
                    where=armature_object.name,
                    advice="choose the control that moves it, or mute its constraints",
                )
            for other, step in enumerate(steps):
                if other != index and abs(steps[index].dot(step)) > np.cos(0.5 * LIMITS.same_rotation_rad):
                    led[other].append(index)
    for index, name in enumerate(bones):
        if led[index]:  # the nearest of the bones that rotate it is itself rotated by the most bones
            found[place[name]] = place[bones[max(led[index], key=lambda other: len(led[other]))]]
    return found


@contextmanager
def _rest_pose(context: bpy.types.Context, armature_object: bpy.types.Object, bones: Sequence[str]) -> Iterator[None]:
    posed = [armature_object.pose.bones[name] for name in bones]
    before = [(bone.rotation_mode, bone.matrix_basis.copy()) for bone in posed]
    try:
        for bone in posed:
            bone.rotation_mode = "QUATERNION"
            bone.matrix_basis.identity()
            bone.rotation_quaternion = Quaternion()
        yield
    finally:
        for bone, (mode, basis) in zip(posed, before, strict=True):
            bone.rotation_mode = mode
            bone.matrix_basis = basis
        context.view_layer.update()


def _turns(context: bpy.types.Context, armature_object: bpy.types.Object, bones: Sequence[str]) -> list[Quaternion]:
    context.view_layer.update()
    evaluated = armature_object.evaluated_get(context.evaluated_depsgraph_get())
    return [evaluated.pose.bones[name].matrix.to_quaternion() for name in bones]


def delta_transforms(
    armature_object: bpy.types.Object, rotations: ArrayLike, locations: ArrayLike
) -> tuple[Array, Array]:
    """Return delta rotations (..., 4) and locations (..., 3) that move an object in its own space.

    The object's rotation mode becomes quaternion: Blender then rotates it by delta · rotation and adds the locations.

    Args:
        rotations: Rotations (..., 4) of the object in its own space.
        locations: Locations (..., 3) in the same space and the armature's unit.
    """
    armature_object.rotation_mode = "QUATERNION"
    own = np.array(armature_object.rotation_quaternion, dtype=np.float64)
    scale = np.array(armature_object.scale, dtype=np.float64)
    scaled = np.asarray(locations, dtype=np.float64) * scale
    turned = np.asarray(rotations, dtype=np.float64) * np.append(1.0, np.sign(scale))  # two mirrored axes: half a turn
    return rot.multiply(rot.multiply(own, turned), rot.conjugate(own)), rot.rotate(own, scaled)
