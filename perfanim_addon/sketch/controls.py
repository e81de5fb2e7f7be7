"""Controls of a sketch: empties at a character's joints, and their keys."""

from collections.abc import Iterable
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from ...core.errors import CharacterError, SettingsError
from ...core.geometry.arrays import Array
from ...core.sketch.key_curves import curve_positions
from ...core.sketch.sketch_file import Control, Sketch
from ..animation.channels import channels_of, play, play_only, played, slot_of
from ..capture.capture_space import CaptureSpace
from ..character.bone_map_settings import joint_label
from ..character.posing import bones_of

JOINT = "perfanim_joint"  # custom property of a control
STORED = "perfanim_sketch"  # custom property of a solved action: its sketch as JSON
_SIZE_M = 0.08  # of a control of a person's hand
_LARGER = {"root": 2.0, "thorax": 1.6, "head": 1.6}
_SHAPES = {"root": "CUBE"}
BREAKDOWN = "BREAKDOWN"  # Keyframe.type of a key that suggests a place and does not bind
_SAME_M = 0.001  # by which a curve may differ from Blender's default
_BREAKDOWNS = 4  # frames from one to the next on a curve that is keyed again


def controls_of(armature_object: bpy.types.Object) -> dict[str, bpy.types.Object]:
    """Return joint -> control of a character's sketch."""
    kept = armature_object.perfanim_sketch.controls
    return {str(each[JOINT]): each for each in (kept.objects if kept is not None else ()) if each.get(JOINT)}


def add_controls(
    context: bpy.types.Context, armature_object: bpy.types.Object, space: CaptureSpace, joints: Iterable[str]
) -> list[str]:
    """Add and select the missing controls at a character's pose; return their names.

    Raises:
        CharacterError: a joint has no bone.
    """
    bones, present = bones_of(armature_object), controls_of(armature_object)
    missing = [joint_label(joint) for joint in joints if joint not in bones]
    if missing:
        advice = "choose its bone in the Character panel, or leave this control out"
        raise CharacterError(f"there is no bone for {', '.join(missing)}", where=armature_object.name, advice=advice)
    context.view_layer.update()
    posed = armature_object.evaluated_get(context.evaluated_depsgraph_get())
    kept = collection_of(context, armature_object)
    names = []
    for joint in joints:
        if joint not in present:
            place = posed.matrix_world @ posed.pose.bones[bones[joint]].head
            names.append(_add_empty(kept, armature_object, joint, place, space.length_in_scene(_SIZE_M)))
    _select(context, names)
    return names


def _select(context: bpy.types.Context, names: list[str]) -> None:
    """Select new controls in Object Mode, so that I keys them."""
    if not names:
        return
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    for each in context.view_layer.objects:
        each.select_set(each.name in names)
    context.view_layer.objects.active = bpy.data.objects[names[0]]


def collection_of(context: bpy.types.Context, armature_object: bpy.types.Object) -> bpy.types.Collection:
    """Return the collection of a character's controls, added where it is missing."""
    chosen = armature_object.perfanim_sketch
    if chosen.controls is None:
        chosen.controls = bpy.data.collections.new(f"Sketch of {armature_object.name}")
        chosen.controls.color_tag = "COLOR_05"
    if chosen.controls not in context.scene.collection.children_recursive:
        context.scene.collection.children.link(chosen.controls)
    return chosen.controls


def _add_empty(
    kept: bpy.types.Collection, armature_object: bpy.types.Object, joint: str, place: Any, size: float
) -> str:
    empty = bpy.data.objects.new(f"{joint_label(joint)} of {armature_object.name}", None)
    empty.empty_display_type = _SHAPES.get(joint, "SPHERE")
    empty.empty_display_size = size * _LARGER.get(joint, 1.0)
    empty.show_in_front, empty.location = True, place
    empty[JOINT] = joint
    kept.objects.link(empty)
    return str(empty.name)


def key_controls(context: bpy.types.Context, armature_object: bpy.types.Object) -> int:
    """Key the controls at the joints where the character's rough action has keys.

    Their earlier keys go. The rough action is the one that the character plays; once that is a solved sketch, it is the
    one that was read before.

    Returns:
        The number of frames with keys.

    Raises:
        SettingsError: the character has no animation, or only a solved one.
    """
    chosen, animation = armature_object.perfanim_sketch, armature_object.animation_data
    playing = animation.action if animation is not None else None
    if playing is not None and STORED not in playing:
        chosen.rough = playing
    elif playing is not None and chosen.rough is None:
        advice = "choose the rough action in the Action editor"
        raise SettingsError("was solved from a sketch", where=playing.name, advice=advice)
    if chosen.rough is None or chosen.rough == playing:
        return _key_where_keyed(context, armature_object)
    before = played(armature_object)
    play_only(armature_object, chosen.rough)
    try:
        return _key_where_keyed(context, armature_object)
    finally:
        play(armature_object, before)


def _key_where_keyed(context: bpy.types.Context, armature_object: bpy.types.Object) -> int:
    """Key the controls where the playing action has keys; return the number of frames."""
    curves = action_curves(armature_object)
    frames = sorted({round(key.co.x) for curve in curves for key in curve.keyframe_points})
    if not frames:
        advice = "animate it roughly, or key the controls by hand"
        raise SettingsError("has no action with keys", where=armature_object.name, advice=advice)
    controls, bones = controls_of(armature_object), bones_of(armature_object)
    for control in controls.values():
        set_free(control)
    armature_object.perfanim_sketch.free_height = False  # of a path that they have followed
    with present_frame(context.scene):
        for frame in frames:
            context.scene.frame_set(frame)
            posed = armature_object.evaluated_get(context.evaluated_depsgraph_get())
            for joint, control in controls.items():
                control.location = posed.matrix_world @ posed.pose.bones[bones[joint]].head
                control.keyframe_insert("location", frame=frame)
    return len(frames)


def set_keys(armature_object: bpy.types.Object, sketch: Sketch, space: CaptureSpace) -> None:
    """Key the controls as a sketch has them.

    Their earlier keys, parents and constraints go. A curve that is not Blender's default becomes keys of the type
    Breakdown.
    """
    controls = controls_of(armature_object)
    for control in sketch.controls:
        empty = controls[control.joint]
        set_free(empty)
        places = space.points_to_scene(control.positions_m)
        for frame, place in _breakdowns(control, places, space):
            empty.location = place
            empty.keyframe_insert("location", frame=frame, keytype=BREAKDOWN)
        for frame, place in zip(control.frames.tolist(), places, strict=True):
            empty.location = place
            empty.keyframe_insert("location", frame=frame)


def _breakdowns(control: Control, places: Array, space: CaptureSpace) -> Iterable[tuple[float, Array]]:
    """Return frames and places between keys (K, 3), none for Blender's default curve."""
    if control.drawn_m is None:
        return []
    steps = np.arange(len(control.drawn_m))
    drawn = space.points_to_scene(control.drawn_m)
    default = curve_positions(control.frames, places, control.frames[0] + steps)
    if np.max(np.abs(drawn - default)) < space.length_in_scene(_SAME_M):
        return []
    between = (steps % _BREAKDOWNS == 0) & ~np.isin(control.frames[0] + steps, control.frames)
    return zip((control.frames[0] + steps[between]).tolist(), drawn[between], strict=True)


def set_free(control: bpy.types.Object) -> None:
    """Take away keys, parent and constraints: keys are places in the scene."""
    control.animation_data_clear()
    control.parent = None
    control.constraints.clear()


@contextmanager
def present_frame(scene: bpy.types.Scene) -> Any:
    """Go back to the present frame at the end."""
    frame, part = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=part)


def action_curves(animated: bpy.types.Object) -> list[bpy.types.FCurve]:
    """Return the curves of an object's action, none without one."""
    animation = animated.animation_data
    if animation is None or animation.action is None:
        return []
    return [curve for bag in channels_of(animation.action, slot_of(animation)) for curve in bag.fcurves]
