"""Creation of characters: armatures with a bone for each joint of the standard skeleton, named for Blender."""

import bpy
import numpy as np

from ...core.body.body_size import standing_root_m
from ...core.body.skeleton import Skeleton
from ...core.errors import CharacterError
from ...core.retarget.bone_map import BoneMap, own_bone_map
from ...core.retarget.displayed_joint_names import BLENDER, naming_of
from . import axes
from .armature_reading import LIMITS
from .body_mesh import add_body
from .selection import select_only

_FORWARD_BONES = ("foot", "toes")


def create_character(context: bpy.types.Context, skeleton: Skeleton, name: str = "Performer") -> str:
    """Add an armature with the skeleton's joints, and a humanoid mesh on it.

    The armature stands at the scene's origin in the rest pose, soles on the floor, facing -Y. The bones' rotation mode
    is quaternion. The new armature becomes the active object, in Object Mode.

    Args:
        skeleton: Standard skeleton with the proportions of the character.
        name: Preferred name of the armature object; Blender may append ".001".

    Returns:
        The armature object's name.
    """
    armature_object = _add_armature(context, skeleton, name)
    heads = skeleton.rest_positions_m + standing_root_m(skeleton)
    add_body(context, skeleton, heads, armature_object)
    return str(armature_object.name)


def _add_armature(context: bpy.types.Context, skeleton: Skeleton, name: str) -> bpy.types.Object:
    active = context.view_layer.objects.active
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    armature = bpy.data.armatures.new(name)
    obj = bpy.data.objects.new(name, armature)
    (context.collection or context.scene.collection).objects.link(obj)
    select_only(context, [obj])
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        _add_bones(armature, skeleton)
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
    for bone in obj.pose.bones:
        bone.rotation_mode = "QUATERNION"
    armature.display_type = "STICK"
    obj.show_in_front = True
    return obj


def _add_bones(armature: bpy.types.Armature, skeleton: Skeleton) -> None:
    heads = axes.points_to_blender(skeleton.rest_positions_m + standing_root_m(skeleton))
    tips = axes.points_to_blender(skeleton.tips_m)
    up, forward = axes.points_to_blender(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    names = [naming_of(BLENDER)[joint] for joint in skeleton.names]
    for joint, name in enumerate(names):
        bone = armature.edit_bones.new(name)
        bone.head = heads[joint]
        length, least = float(np.linalg.norm(tips[joint])), LIMITS.shortest_bone_m
        longer = least * (tips[joint] / length if length > 1e-6 else up)
        bone.tail = heads[joint] + (tips[joint] if length >= least else longer)
        # this roll makes knees, elbows and the spine bend about their local X axis, as animators expect
        bone.align_roll(up if skeleton.names[joint][1:] in _FORWARD_BONES else forward)
        parent = skeleton.parents[joint]
        if parent >= 0:
            bone.parent = armature.edit_bones[names[parent]]


def find_armature(object_name: str) -> bpy.types.Object:
    """Return the armature object with a name; CharacterError if there is none."""
    obj = bpy.data.objects.get(object_name)
    if obj is None:
        raise CharacterError(
            f"there is no object {object_name!r}", advice="pick an armature under Character or add a character"
        )
    if not obj.users_scene:  # a setting keeps a deleted object in the file
        advice = "undo, or pick another armature under Character"
        raise CharacterError("was deleted from the scene", where=object_name, advice=advice)
    if obj.type != "ARMATURE":
        raise CharacterError(
            f"{object_name!r} is of type {obj.type.lower()}, not an armature", advice="pick the armature that moves it"
        )
    return obj


def own_map(armature_object: bpy.types.Object) -> BoneMap | None:
    """Return the bone map of a character made by `create_character`, or None for others."""
    return own_bone_map(armature_object.data.bones.keys())
