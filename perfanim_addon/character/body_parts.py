"""Parts of the body for a capture, and the bones that belong to them."""

from collections.abc import Collection

import bpy

from ...core.retarget.retargeter import RetargetPlan
from .posing import bones_of

_MIDDLE = {"HIPS": ("root",), "TORSO": ("lowerback", "upperback", "thorax"), "HEAD": ("lowerneck", "upperneck", "head")}
_SIDED = {
    "ARM": ("clavicle", "humerus", "radius", "wrist", "hand", "fingers", "thumb"),
    "LEG": ("femur", "tibia", "foot", "toes"),
}
PARTS = (*_MIDDLE, *(f"{part}_{side}" for part in _SIDED for side in "LR"))
_PART_OF = {joint: part for part, joints in _MIDDLE.items() for joint in joints} | {
    side + joint: f"{part}_{side.upper()}" for part, joints in _SIDED.items() for side in "lr" for joint in joints
}


def bones_of_parts(
    armature_object: bpy.types.Object, plan: RetargetPlan, parts: Collection[str]
) -> frozenset[str] | None:
    """Return the bones moved with only some parts of the body, None for all.

    A bone that stands for no joint belongs to the part of the next one above it that does; those above all to the hips.

    Args:
        armature_object: driven by `plan`.
        parts: of `PARTS`.

    Raises:
        CharacterError: no bone map is found.
    """
    if set(parts) >= set(PARTS):
        return None
    part_of = {bone: _PART_OF[joint] for joint, bone in bones_of(armature_object).items()}
    bones = armature_object.pose.bones
    found = set()
    for name in {*plan.bones, *plan.located}:
        line = (name, *(bone.name for bone in bones[name].parent_recursive))
        part = next((part_of[bone] for bone in line if bone in part_of), "HIPS")
        found |= {name} if part in parts else set()
    return frozenset(found)
