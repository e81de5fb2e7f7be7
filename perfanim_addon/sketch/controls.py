"""Controls of a sketch: empties at a character's joints, and their keys."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ...core.body.standard_skeleton import joint_label
from ...core.errors import CharacterError, SettingsError
from ...core.geometry.arrays import Array
from ...core.sketch.key_interpolation import curve_positions
from ...core.sketch.sketch_file import Control, Sketch
from ..animation.actions import present_frame
from ..blender_versions import action_curves, play, play_only, played
from ..capture.capture_space import CaptureSpace
from ..character.retarget_plans import bones_of
from ..character.selection import leave_modes, select_only

JOINT = "perfanim_joint"  # custom property of a control
STORED = "perfanim_sketch"  # custom property of a solved action: its sketch as JSON
BREAKDOWN = "BREAKDOWN"  # Keyframe.type of a key that suggests a position but is not binding


@dataclass(frozen=True)
class SketchEditing:
    """Tuned numbers for sketches in Blender."""

    size_m: float = 0.08  # display size of a hand's control on a person
    sizes: tuple[tuple[str, float], ...] = (("root", 2.0), ("thorax", 1.6), ("head", 1.6))  # relative to a hand's
    same_curve_m: float = 0.001  # distance from Blender's default curve up to which no breakdown keys are needed
    step: int = 4  # frames between breakdown keys, and between samples of a control on a path or with a parent
    off_curve: float = 1e-4  # distance from its curves, scene units, at which a control or bone counts as dragged
    farthest_m: float = 1000.0  # largest distance of a key from the character's origin
    walk_speed: float = 0.8  # scene units per second along a path if no key determines its duration: a calm walk
    flat: float = 0.05  # largest height of a path that counts as lying on the floor, in the character's metres
    listed: int = 3  # largest number of unmet keys or clips in the panel's message
    tick_s: float = 0.015  # time between two checks for edits while live
    slice_s: float = 0.004  # time per check spent on filling curves


EDITING = SketchEditing()


def controls_of(armature_object: bpy.types.Object) -> dict[str, bpy.types.Object]:
    """Return joint -> control of a character's sketch."""
    kept = armature_object.perfanim_sketch.controls
    return {str(each[JOINT]): each for each in (kept.objects if kept is not None else ()) if each.get(JOINT)}


def add_controls(
    context: bpy.types.Context, armature_object: bpy.types.Object, space: CaptureSpace, joints: Iterable[str]
) -> list[str]:
    """Add and select the missing controls at a character's pose; return their names; CharacterError without a bone."""
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
            size = dict(EDITING.sizes).get(joint, 1.0) * space.length_in_scene(EDITING.size_m)
            names.append(_add_empty(kept, armature_object, joint, place, size))
    if names:
        leave_modes(context)  # the key I then inserts keyframes for the controls
        select_only(context, [bpy.data.objects[name] for name in names])
    return names


def collection_of(context: bpy.types.Context, armature_object: bpy.types.Object) -> bpy.types.Collection:
    """Return the collection of a character's controls, adding it if it is missing."""
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
    empty.empty_display_type = "CUBE" if joint == "root" else "SPHERE"
    empty.empty_display_size = size
    empty.show_in_front, empty.location = True, place
    empty[JOINT] = joint
    kept.objects.link(empty)
    return str(empty.name)


def key_controls(context: bpy.types.Context, armature_object: bpy.types.Object) -> int:
    """Key the controls where the character's rough action has keys; return the number of frames.

    Earlier keys are removed. The rough action is the active one; if that is a solved sketch, the rough action read
    last. SettingsError if there is none.
    """
    chosen, animation = armature_object.perfanim_sketch, armature_object.animation_data
    playing = animation.action if animation is not None else None
    if playing is not None and STORED not in playing:
        chosen.rough = playing
    elif playing is not None and chosen.rough is None:
        advice = "choose the rough action in the Action Editor"
        raise SettingsError("is a solved sketch, not a rough action", where=playing.name, advice=advice)
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
    armature_object.perfanim_sketch.free_height = False  # a followed path may have set it
    with present_frame(context.scene):
        for frame in frames:
            context.scene.frame_set(frame)
            posed = armature_object.evaluated_get(context.evaluated_depsgraph_get())
            for joint, control in controls.items():
                control.location = posed.matrix_world @ posed.pose.bones[bones[joint]].head
                control.keyframe_insert("location", frame=frame)
    return len(frames)


def set_keys(armature_object: bpy.types.Object, sketch: Sketch, space: CaptureSpace) -> None:
    """Key the controls as in a sketch.

    Earlier keys, parents and constraints are removed. A curve other than Blender's default gets breakdown keys.
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
    """Return frames and positions (K, 3) of breakdown keys; none for Blender's default curve."""
    if control.drawn_m is None:
        return []
    steps = np.arange(len(control.drawn_m))
    drawn = space.points_to_scene(control.drawn_m)
    default = curve_positions(control.frames, places, control.frames[0] + steps)
    if np.max(np.abs(drawn - default)) < space.length_in_scene(EDITING.same_curve_m):
        return []
    between = (steps % EDITING.step == 0) & ~np.isin(control.frames[0] + steps, control.frames)
    return zip((control.frames[0] + steps[between]).tolist(), drawn[between], strict=True)


def only_constraint(control: bpy.types.Object, kind: str) -> Any:
    """Return a control's constraint if it has the given type and full influence, and nothing else moves the control."""
    held = control.constraints[0] if len(control.constraints) == 1 and control.parent is None else None
    is_full = held is not None and held.type == kind and not held.mute and held.influence >= 1.0
    return held if is_full and held.target is not None else None


def set_free(control: bpy.types.Object) -> None:
    """Remove keys, parent and constraints, so that keys are positions in the scene."""
    control.animation_data_clear()
    control.parent = None
    control.constraints.clear()
