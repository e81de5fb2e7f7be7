"""Controls that follow the bones of a roughly animated rig."""

import bpy

from ...core.errors import CharacterError, SettingsError
from ..blender_versions import action_curves
from ..character.retarget_plans import bones_of
from ..character.selection import select_only
from .controls import STORED, collection_of, controls_of, set_free


def rough_copy(context: bpy.types.Context, armature_object: bpy.types.Object) -> bpy.types.Object:
    """Add and select a wire copy of a character with its rough action; SettingsError if there is no such action."""
    if not action_curves(armature_object):
        advice = "animate it roughly first, or select an animated rig"
        raise SettingsError("has no action with keys", where=armature_object.name, advice=advice)
    action = armature_object.animation_data.action
    if STORED in action:
        advice = "choose the rough action in the Action Editor, or select a roughly animated rig"
        raise SettingsError("is a solved sketch, not a rough action", where=action.name, advice=advice)
    rig = armature_object.copy()
    rig.name = f"Rough {armature_object.name}"
    rig.perfanim_sketch.controls = None  # the controls belong to the character
    rig.display_type, rig.show_in_front = "WIRE", True
    collection_of(context, armature_object).objects.link(rig)
    context.view_layer.update()
    select_only(context, [rig])
    return rig


def follow(armature_object: bpy.types.Object, rig: bpy.types.Object) -> int:
    """Make controls follow the bones of the same joints in a rig; return the number of controls.

    The controls' own keys are removed. Keys of the rig are binding; Live solves again when one moves. CharacterError if
    a bone is missing.
    """
    bones, controls = bones_of(rig), controls_of(armature_object)
    missing = [each.name for joint, each in controls.items() if joint not in bones]
    if missing:
        raise CharacterError(
            f"there is no bone for {', '.join(missing)}", where=rig.name, advice="delete the controls without a bone"
        )
    for joint, control in controls.items():
        set_free(control)
        held = control.constraints.new("COPY_LOCATION")
        held.target, held.subtarget = rig, bones[joint]
    armature_object.perfanim_sketch.free_height = False  # a followed path may have set it
    return len(controls)
