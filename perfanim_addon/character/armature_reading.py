"""Blender's armatures as retargeting needs them: rest pose and real ancestry.

In control rigs a bone may follow another than its parent, through constraints. That is not guessed but tried: one
bone after the other is turned, and which of the others went along is seen.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import bpy
import numpy as np
from mathutils import Quaternion
from numpy.typing import ArrayLike

from ...core.errors import CharacterError
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array, IntArray
from ...core.retarget.armature_rest import ArmatureRest

_FK_SWITCH = "IK_FK"  # Rigify's property of a limb: 0 inverse, 1 forward kinematics
_FOLLOW_SWITCHES = ("neck_follow", "head_follow")  # 1: the neck goes along with the chest, the head with the neck
_TRIED = Quaternion((0.3, 0.8, -0.5), 0.7)
_SAME_RADIANS = 0.02
_SAME_SCALE = 0.01  # up to which a limb may change its length in the scene while it turns
_APPLY = "apply its scale (Object > Apply > Scale), and that of its parent"


def read_armature_rest(armature_object: bpy.types.Object) -> ArmatureRest:
    """Return the rest pose of all bones of an armature object.

    Raises:
        CharacterError: it has none.
    """
    bones = list(armature_object.data.bones)  # Blender keeps parents before their children
    place = {bone.name: index for index, bone in enumerate(bones)}
    count = len(bones)
    return ArmatureRest(
        names=tuple(place),
        parents=np.array([place[bone.parent.name] if bone.parent else -1 for bone in bones], dtype=np.int64),
        heads=np.array([bone.head_local for bone in bones], dtype=np.float64).reshape(count, 3),
        tails=np.array([bone.tail_local for bone in bones], dtype=np.float64).reshape(count, 3),
        axes=np.array([bone.matrix_local.to_3x3().normalized() for bone in bones], dtype=np.float64).reshape(-1, 3, 3),
        deform=np.array([bone.use_deform for bone in bones], dtype=bool),
        inherits_rotation=np.array([bone.use_inherit_rotation for bone in bones], dtype=bool),
        local_location=np.array([bone.use_local_location for bone in bones], dtype=bool),
        connected=np.array([bone.use_connect for bone in bones], dtype=bool),
    )


def check_scale(armature_object: bpy.types.Object) -> None:
    """Refuse an armature that the scene shows stretched or mirrored.

    Bones turn in the armature's own space. Where the scene shows that stretched along one axis more than along another,
    by its own scale or a parent's, limbs would change their lengths as they turn; where it shows it mirrored, the
    character would go left when the performer goes right.

    Raises:
        CharacterError: the scene shows it stretched or mirrored.
    """
    axes = np.array(armature_object.matrix_world.to_3x3(), dtype=np.float64)
    lengths = np.linalg.svd(axes, compute_uv=False)
    name = armature_object.name
    if lengths[0] > (1.0 + _SAME_SCALE) * lengths[-1]:
        how = f"{lengths[0] / lengths[-1]:.3g} times longer" if lengths[-1] > 0.0 else "flat"
        raise CharacterError(f"the scene shows it stretched, {how} in one direction", where=name, advice=_APPLY)
    if np.linalg.det(axes) < 0.0:
        advice = f"make the scale positive, or {_APPLY}"
        raise CharacterError("the scene shows it mirrored by a negative scale", where=name, advice=advice)


def clear_offsets(armature_object: bpy.types.Object, turned: Iterable[str], moved: Iterable[str]) -> None:
    """Reset scale and location of turned bones after an earlier animation.

    A joint out of its place, or a limb of another length, would carry all that hangs on it away.

    Args:
        moved: those with a location set with the motion.
    """
    kept = set(moved)
    for name in turned:
        bone = armature_object.pose.bones[name]
        bone.scale = (1.0, 1.0, 1.0)
        if name not in kept:
            bone.location = (0.0, 0.0, 0.0)


def switch_to_fk(armature_object: bpy.types.Object, bones: Sequence[str]) -> None:
    """Let a rig follow the rotations of the given bones.

    Rigify's switches go to forward kinematics, and inverse kinematics that ends in one of the bones is muted.
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
    """Tell whether a bone or one above it has constraints."""
    for name in bones:
        bone = armature_object.pose.bones[name]
        while bone is not None:
            if len(bone.constraints):
                return True
            bone = bone.parent
    return False


def followed_bones(context: bpy.types.Context, armature_object: bpy.types.Object, bones: Sequence[str]) -> IntArray:
    """Return for each bone (B,) the one of `bones` that turns it, -1 for none.

    Only those in `bones`, parents before their children, have one. The pose is as before afterwards.

    Raises:
        CharacterError: constraints hold a bone, so that turning it does nothing.
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
                if other != index and abs(steps[index].dot(step)) > np.cos(0.5 * _SAME_RADIANS):
                    led[other].append(index)
    for index, name in enumerate(bones):
        if led[index]:  # of all that lead it, the one that most others lead
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
    """Return delta rotations and locations that move an object in its own space.

    The object is switched to quaternions, in which Blender turns it by delta · rotation and adds the locations.

    Args:
        rotations, locations: (..., 4), (..., 3) of the object in its own space, in the armature's unit.
    """
    armature_object.rotation_mode = "QUATERNION"
    own = np.array(armature_object.rotation_quaternion, dtype=np.float64)
    scale = np.array(armature_object.scale, dtype=np.float64)
    scaled = np.asarray(locations, dtype=np.float64) * scale
    turned = np.asarray(rotations, dtype=np.float64) * np.append(1.0, np.sign(scale))  # two negative ones: half a turn
    return rot.multiply(rot.multiply(own, turned), rot.conjugate(own)), rot.rotate(own, scaled)
