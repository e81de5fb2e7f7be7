"""Parts of the body that a capture moves: which bones of an armature belong to them."""

from collections.abc import Collection

import bpy

from ..preferences.paths import user_folder
from .bone_map_settings import stored_map
from .posing import PRESETS_FOLDER, Posing, ProductPosing, find_map

_MIDDLE = {
    "HIPS": ("root",),
    "TORSO": ("lowerback", "upperback", "thorax"),
    "HEAD": ("lowerneck", "upperneck", "head"),
}
_SIDED = {
    "ARM": ("clavicle", "humerus", "radius", "wrist", "hand", "fingers", "thumb"),
    "LEG": ("femur", "tibia", "foot", "toes"),
}
PARTS = (*_MIDDLE, *(f"{part}_{side}" for part in _SIDED for side in "LR"))
_PART_OF = {joint: part for part, joints in _MIDDLE.items() for joint in joints} | {
    side + joint: f"{part}_{side.upper()}" for part, joints in _SIDED.items() for side in "lr" for joint in joints
}


def bones_of_parts(armature_object: bpy.types.Object, posing: Posing, parts: Collection[str]) -> frozenset[str] | None:
    """Return the bones that are moved when only some parts of the body are; None when all are.

    A bone that stands for no joint belongs to the part of the next one above it that does; those above all to the hips.

    Args:
        armature_object: driven by `posing`.
        parts: of `PARTS`.

    Raises:
        CharacterError: its bone map cannot be told.
    """
    if set(parts) >= set(PARTS):
        return None
    if isinstance(posing, ProductPosing):
        part_of = _PART_OF
    else:
        bone_map = stored_map(armature_object) or find_map(armature_object, user_folder(PRESETS_FOLDER))
        part_of = {bone: _PART_OF[joint] for joint, bone in bone_map.bones.items()}
    bones = armature_object.pose.bones
    found = set()
    for name in {*posing.bones, *posing.located}:
        line = (name, *(bone.name for bone in bones[name].parent_recursive))
        part = next((part_of[bone] for bone in line if bone in part_of), "HIPS")
        found |= {name} if part in parts else set()
    return frozenset(found)
