"""Standard skeletons with the proportions of Blender's characters, and plans that copy their joints to the bones."""

from collections.abc import Sequence
from dataclasses import replace

import bpy

from ...core.body.skeleton import Skeleton
from ...core.retarget.character_fit import Adjustments
from ...core.retarget.character_skeleton import character_skeleton
from ...core.retarget.retargeter import RetargetPlan
from .armature_reading import read_armature_rest
from .bone_map_settings import stored_map, stored_root_motion
from .create_character import own_map
from .retarget_plans import bones_of, character_fit, map_of, plan_with_map


def own_skeleton(armature_object: bpy.types.Object) -> Skeleton:
    """Return the standard skeleton with a character's proportions; CharacterError without a bone map.

    A foreign character is scaled to a person's size: its legs get the default skeleton's length.
    """
    rest, bones = read_armature_rest(armature_object), bones_of(armature_object)
    is_own = own_map(armature_object) is not None and stored_map(armature_object) is None
    fit = replace(character_fit(armature_object, rest, bones), adjustments=Adjustments())
    return character_skeleton(armature_object.name, rest, bones, is_own, fit)


def own_body_plans(armature_object: bpy.types.Object, adjustments: Sequence[Adjustments]) -> list[RetargetPlan]:
    """Return plans from a character's own skeleton, one for each of some adjustments; CharacterError without a map."""
    skeleton, bone_map = own_skeleton(armature_object), map_of(armature_object)
    root_motion = stored_root_motion(armature_object)
    return [plan_with_map(armature_object, skeleton, bone_map, root_motion, each) for each in adjustments]
