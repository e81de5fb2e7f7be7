"""Standard skeletons with the proportions of Blender's characters."""

import bpy

from ...core.body.skeleton import Skeleton
from ...core.retarget.character_skeleton import character_skeleton
from ..character.armature_reading import read_armature_rest
from ..character.bone_map_settings import stored_map
from ..character.create_character import joints_without_bone
from ..character.retarget_plans import bones_of, character_fit


def own_skeleton(armature_object: bpy.types.Object) -> Skeleton:
    """Return the standard skeleton with a character's proportions; CharacterError without a bone map.

    A foreign character is scaled to a person's size: its legs get the default skeleton's length.
    """
    rest, bones = read_armature_rest(armature_object), bones_of(armature_object)
    is_own = not joints_without_bone(armature_object) and stored_map(armature_object) is None
    return character_skeleton(armature_object.name, rest, bones, is_own, character_fit(armature_object, rest, bones))
