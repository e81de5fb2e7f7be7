"""Controls of a sketch: empties at a character's joints, and their keys."""

from collections.abc import Iterable, Mapping
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from ...core.body.motion import LEAST_FPS, MOST_FPS
from ...core.errors import CharacterError, SettingsError
from ...core.geometry.arrays import Array
from ...core.sketch.sketch import MOST_FRAMES, Control, Sketch
from ..animation.actions import scene_fps
from ..animation.channels import channels_of, play, play_only, played, slot_of
from ..capture.capture_space import CaptureSpace
from ..character.bone_map_settings import joint_label
from ..character.posing import bones_of
from .path_places import places_on_path

JOINT = "perfanim_joint"  # custom property of a control
STORED = "perfanim_sketch"  # custom property of a solved action: its sketch as JSON
_SIZE_M = 0.08  # of a control of a person's hand
_LARGER = {"root": 2.0, "thorax": 1.6, "head": 1.6}
_SHAPES = {"root": "CUBE"}
_FARTHEST_M = 1000.0
_MOVED = 1e-4  # of a location, by which a control is off its curves while it is dragged
_ALONG_PATH = 8  # frames between two positions on a path or under a parent


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
    kept = _collection(context, armature_object)
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


def _collection(context: bpy.types.Context, armature_object: bpy.types.Object) -> bpy.types.Collection:
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
        _set_free(control)
    with _present_frame(context.scene):
        for frame in frames:
            context.scene.frame_set(frame)
            posed = armature_object.evaluated_get(context.evaluated_depsgraph_get())
            for joint, control in controls.items():
                control.location = posed.matrix_world @ posed.pose.bones[bones[joint]].head
                control.keyframe_insert("location", frame=frame)
    return len(frames)


def set_keys(armature_object: bpy.types.Object, sketch: Sketch, space: CaptureSpace) -> None:
    """Key the controls as a sketch has them.

    Their earlier keys, parents and constraints go.
    """
    controls = controls_of(armature_object)
    for control in sketch.controls:
        empty = controls[control.joint]
        _set_free(empty)
        for frame, place in zip(control.frames, space.points_to_scene(control.positions_m), strict=True):
            empty.location = place
            empty.keyframe_insert("location", frame=float(frame))


def _set_free(control: bpy.types.Object) -> None:
    """Take away keys, parent and constraints: keys are places in the scene."""
    control.animation_data_clear()
    control.parent = None
    control.constraints.clear()


def read_controls(
    context: bpy.types.Context,
    armature_object: bpy.types.Object,
    space: CaptureSpace,
    dragged: bool = False,
    seen: Mapping[str, Control] | None = None,
) -> Sketch:
    """Return the sketch of a character's keyed controls, frames as in the scene.

    A control on a path or with a parent is read where the scene shows it, every few frames.

    Args:
        dragged: a control that is moved off its curves has a key in the present frame. The scene stays as it is: of
            the controls with a parent or constraints only those that follow a curve are read.
        seen: joint -> control as read before, for those that are not read.

    Raises:
        SettingsError: no key, too many frames, or a control beyond all bounds.
    """
    scene, found = context.scene, []
    for joint, control in controls_of(armature_object).items():
        keys = _keys(context, control, dragged)
        if keys is None:
            found += [seen[joint]] if seen and joint in seen else []
        elif keys:
            frames = np.array(sorted(keys), dtype=np.float64)
            points_m = space.points_from_scene(np.array([keys[frame] for frame in sorted(keys)]))
            _check_far(control.name, points_m)
            found.append(Control(joint, frames, points_m))
    if not found:
        advice = "move a control and press I over the viewport (Insert Keyframe: Location)"
        raise SettingsError("no control has a key", where=armature_object.name, advice=advice)
    sketch = Sketch(armature_object.name, scene_fps(scene), tuple(found))
    if not LEAST_FPS <= sketch.fps <= MOST_FPS:
        advice = f"set {LEAST_FPS:g} to {MOST_FPS:g} in the Output properties"
        raise SettingsError(f"the scene has {sketch.fps:g} frames a second", advice=advice)
    first, last = min(each.frames[0] for each in found), max(each.frames[-1] for each in found)
    if last - first >= MOST_FRAMES:
        raise SettingsError(f"the keys span {last - first:.0f} frames, {MOST_FRAMES} at most", advice="move the last")
    return sketch


def _keys(context: bpy.types.Context, control: bpy.types.Object, dragged: bool) -> Mapping[int, Array] | None:
    """Return frame -> location in the scene of each key of a control.

    None for one that is dragged, with a parent or constraints that place it where only other frames show.
    """
    scene, curves = context.scene, action_curves(control)
    if control.parent is not None or len(control.constraints):
        frames = _frames_along(curves)
        return places_on_path(context, control, curves, frames) if dragged else _shown_along(scene, control, frames)
    channels = {curve.array_index: curve for curve in curves if curve.data_path == "location"}
    frames = {round(key.co.x) for curve in channels.values() for key in curve.keyframe_points}

    def place(frame: int) -> Array:
        own = [channels[i].evaluate(frame) if i in channels else control.location[i] for i in range(3)]
        return np.array(own, dtype=np.float64)

    keys = {frame: place(frame) for frame in frames}
    now, here = scene.frame_current, np.array(control.location, dtype=np.float64)
    if dragged and frames and np.max(np.abs(place(now) - here)) > _MOVED:
        keys[now] = here
    return keys


def _frames_along(curves: Iterable[bpy.types.FCurve]) -> list[int]:
    """Return the frames of the keys of any channel, and often between them."""
    frames = {round(key.co.x) for curve in curves for key in curve.keyframe_points}
    if frames and max(frames) - min(frames) < MOST_FRAMES:
        frames |= set(range(min(frames), max(frames), _ALONG_PATH))
    return sorted(frames)


def _shown_along(scene: bpy.types.Scene, control: bpy.types.Object, frames: list[int]) -> Mapping[int, Array]:
    """Return frame -> location where the scene shows a control."""
    if frames and frames[-1] - frames[0] >= MOST_FRAMES:
        return {frame: np.array(control.matrix_world.translation) for frame in frames}
    found = {}
    with _present_frame(scene):
        for frame in frames:
            scene.frame_set(frame)
            shown = control.evaluated_get(bpy.context.evaluated_depsgraph_get())
            found[frame] = np.array(shown.matrix_world.translation, dtype=np.float64)
    return found


@contextmanager
def _present_frame(scene: bpy.types.Scene) -> Any:
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


def _check_far(name: str, points_m: Array) -> None:
    farthest_m = float(np.max(np.abs(points_m), initial=0.0))
    if not farthest_m <= _FARTHEST_M:
        advice = f"keep it within {_FARTHEST_M:g} m of the character's origin"
        raise SettingsError(f"a key lies {farthest_m:.0f} m away", where=name, advice=advice)
