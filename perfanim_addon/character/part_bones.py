"""Bones of the body parts in the capture settings."""

from collections.abc import Collection

import bpy

from ...core.body import body_parts
from ...core.retarget.retargeter import RetargetPlan
from .retarget_plans import bones_of

_PARTS_OF = {"HIPS": ("hips",), "TORSO": ("torso",), "HEAD": ("head",)} | {
    f"{limb}_{side[0].upper()}": (f"{side} {limb.lower()}", f"{side} {end}")
    for limb, end in (("ARM", "hand"), ("LEG", "foot"))
    for side in ("left", "right")
}
PARTS = tuple(_PARTS_OF)
_PART_OF = {"root": "hips"} | {joint: part for part, joints in body_parts.PARTS.items() for joint in joints}


def bones_of_parts(
    armature_object: bpy.types.Object, plan: RetargetPlan, parts: Collection[str]
) -> frozenset[str] | None:
    """Return the bones of some body parts (see `PARTS`), or None for all; CharacterError without a bone map."""
    if set(parts) >= set(PARTS):
        return None
    chosen = {each for part in parts for each in _PARTS_OF[part]}
    return frozenset(bone for bone, part in part_of_bones(armature_object, plan).items() if part in chosen)


def part_of_bones(armature_object: bpy.types.Object, plan: RetargetPlan) -> dict[str, str]:
    """Return the body part of each moved bone; CharacterError without a bone map.

    A bone without a joint belongs to the part of its nearest mapped ancestor, or else to the hips.
    """
    part_of = {bone: _PART_OF[joint] for joint, bone in bones_of(armature_object).items()}
    bones, found = armature_object.pose.bones, {}
    for name in {*plan.bones, *plan.located}:
        line = (name, *(bone.name for bone in bones[name].parent_recursive))
        found[name] = next((part_of[bone] for bone in line if bone in part_of), "hips")
    return found
