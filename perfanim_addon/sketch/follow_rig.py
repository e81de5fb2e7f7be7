"""Controls that go with the bones of a roughly animated rig."""

import bpy

from ...core.errors import CharacterError, SettingsError
from ..character.posing import bones_of
from .controls import STORED, action_curves, collection_of, controls_of, set_free


def rough_copy(context: bpy.types.Context, armature_object: bpy.types.Object) -> bpy.types.Object:
    """Add and select a copy of a character, to be posed in its place.

    It is drawn in wire and plays the rough action.

    Raises:
        SettingsError: the character plays no action with keys, or a solved one.
    """
    if not action_curves(armature_object):
        advice = "animate it roughly first, or select a rig that is animated"
        raise SettingsError("has no action with keys", where=armature_object.name, advice=advice)
    action = armature_object.animation_data.action
    if STORED in action:
        advice = "choose the rough action in the Action editor, or select a rig that is animated roughly"
        raise SettingsError("was solved from a sketch", where=action.name, advice=advice)
    rig = armature_object.copy()
    rig.name = f"Rough {armature_object.name}"
    rig.perfanim_sketch.controls = None  # those of the character
    rig.display_type, rig.show_in_front = "WIRE", True
    collection_of(context, armature_object).objects.link(rig)
    context.view_layer.update()
    for each in context.view_layer.objects:
        each.select_set(each == rig)
    context.view_layer.objects.active = rig
    return rig


def follow(armature_object: bpy.types.Object, rig: bpy.types.Object) -> int:
    """Let the controls of a character go with the same joints' bones of a rig.

    Their own keys go. Keys of the rig bind; Live solves again when one moves.

    Returns:
        The number of controls.

    Raises:
        CharacterError: the rig has no bone for a control, or no bone map is found.
    """
    bones, controls = bones_of(rig), controls_of(armature_object)
    missing = [each.name for joint, each in controls.items() if joint not in bones]
    if missing:
        raise CharacterError(f"there is no bone for {', '.join(missing)}", where=rig.name, advice="delete this control")
    for joint, control in controls.items():
        set_free(control)
        held = control.constraints.new("COPY_LOCATION")
        held.target, held.subtarget = rig, bones[joint]
    armature_object.perfanim_sketch.free_height = False  # of a path that they have followed
    return len(controls)
