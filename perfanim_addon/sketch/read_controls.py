"""Keys and curves of a sketch's controls, read for the solver."""

from collections.abc import Iterable, Mapping

import bpy
import numpy as np

from ...core.body.motion import LEAST_FPS, MOST_FPS
from ...core.errors import SettingsError
from ...core.geometry.arrays import Array
from ...core.sketch.key_interpolation import curve_positions
from ...core.sketch.sketch_file import LIMITS, Control, Sketch
from ..animation.actions import present_frame, scene_fps
from ..blender_versions import action_curves
from ..capture.capture_space import CaptureSpace
from .bone_places import curves_that_move, followed_bone, place_off_curves, places_of_bone
from .controls import BREAKDOWN, EDITING, controls_of
from .path_places import places_on_path

Keys = tuple[Mapping[int, Array], Array | None]  # frame -> location in the scene, and the curve for `Control.drawn_m`


def read_controls(
    context: bpy.types.Context,
    armature_object: bpy.types.Object,
    space: CaptureSpace,
    dragged: bool = False,
    seen: Mapping[str, Control] | None = None,
) -> Sketch:
    """Return the sketch of a character's keyed controls, with keys numbered by scene frame.

    Keys are binding; breakdown keys only if they are the first or the last. Between keys a control follows its
    F-curves, or its motion in the scene if it has a path, a parent or a bone to follow.

    Args:
        dragged: Give a control that is off its curves a key in the current frame. The scene's frame is not changed, so
            controls with a parent or constraints are read only if they follow a path or a bone.
        seen: The last reading's control per joint, for controls that are not read.

    Raises:
        SettingsError: No control has a key, the keys span too many frames, or a key is too far away.
    """
    scene, found = context.scene, []
    for joint, control in controls_of(armature_object).items():
        read = _keys(context, control, dragged)
        if read is None:
            found += [seen[joint]] if seen and joint in seen else []
            continue
        keys, drawn = read
        if keys:
            frames = np.array(sorted(keys), dtype=np.float64)
            points_m = space.points_from_scene(np.array([keys[frame] for frame in sorted(keys)]))
            farthest_m = float(np.max(np.abs(points_m)))
            if not farthest_m <= EDITING.farthest_m:
                advice = f"keep its keys within {EDITING.farthest_m:g} m"
                raise SettingsError(
                    f"has a key {farthest_m:.0f} m from the character's origin", where=control.name, advice=advice
                )
            drawn_m = None if drawn is None else space.points_from_scene(drawn)
            is_free = joint == "root" and armature_object.perfanim_sketch.free_height
            found.append(Control(joint, frames, points_m, drawn_m, is_free))
    if not found:
        advice = "move a control and press I over the viewport (Insert Keyframe: Location)"
        raise SettingsError("no control has a key", where=armature_object.name, advice=advice)
    sketch = Sketch(armature_object.name, scene_fps(scene), tuple(found))
    if not LEAST_FPS <= sketch.fps <= MOST_FPS:
        advice = f"set a frame rate of {LEAST_FPS:g} to {MOST_FPS:g} in the Output properties"
        raise SettingsError(f"the scene has {sketch.fps:g} frames per second", advice=advice)
    first, last = min(each.frames[0] for each in found), max(each.frames[-1] for each in found)
    if last - first >= LIMITS.most_frames:
        message = (
            f"the keys of its controls span {last - first:.0f} frames, but at most {LIMITS.most_frames} are possible"
        )
        raise SettingsError(message, where=armature_object.name, advice="move the first or the last key closer")
    return sketch


def _keys(context: bpy.types.Context, control: bpy.types.Object, dragged: bool) -> Keys | None:
    """Return the keys of a control and the curve between them, or None if the scene's frame would have to change."""
    curves = action_curves(control)
    if control.parent is not None or len(control.constraints):
        return _keys_along(context, control, curves, dragged)
    channels = {curve.array_index: curve for curve in curves if curve.data_path == "location"}

    def places(frames: Iterable[int]) -> Array:
        axes = [[channels[i].evaluate(f) if i in channels else control.location[i] for f in frames] for i in range(3)]
        return np.array(axes, dtype=np.float64).T

    frames = _binding(channels.values())
    keys = dict(zip(frames, places(frames), strict=True))
    now, here = context.scene.frame_current, np.array(control.location, dtype=np.float64)
    if dragged and frames and np.max(np.abs(places([now])[0] - here)) > EDITING.off_curve:
        keys[now] = here
    if not keys or _is_too_long(sorted(keys)):
        return keys, None
    # also for Blender's default curve, which is clamped per axis and so differs in the axes of a rotated character
    return keys, places(range(min(keys), max(keys) + 1))


def _binding(curves: Iterable[bpy.types.FCurve]) -> list[int]:
    """Return the frames of binding keys: the first, the last, and all that are not breakdowns."""
    keys = [(round(key.co.x), key.type != BREAKDOWN) for curve in curves for key in curve.keyframe_points]
    frames = [frame for frame, _ in keys]
    return sorted({frame for frame, binds in keys if binds} | ({min(frames), max(frames)} if frames else set()))


def _is_too_long(frames: list[int]) -> bool:
    """Return whether keys span more frames than a sketch may have."""
    return frames[-1] - frames[0] >= LIMITS.most_frames


def _keys_along(
    context: bpy.types.Context, control: bpy.types.Object, curves: list[bpy.types.FCurve], dragged: bool
) -> Keys | None:
    """Return the same as `_keys` for a control with a parent or constraints; keys in all channels count."""
    followed = followed_bone(control)
    frames = _binding(curves if followed is None else curves_that_move(*followed))
    if not frames:
        return {}, None
    steps = sorted({*frames, *([] if _is_too_long(frames) else range(frames[0], frames[-1], EDITING.step))})
    places: Mapping[int, Array] | None
    if not dragged:
        places = _shown_along(context.scene, control, steps)
    elif followed is None:
        places = places_on_path(context, control, curves, steps)
    else:
        places = places_of_bone(*followed, steps)
    if places is None:
        return None
    posed = place_off_curves(*followed, context.scene.frame_current) if dragged and followed is not None else None
    if posed is not None:
        places = {**places, context.scene.frame_current: posed}
        frames, steps = (sorted({*each, context.scene.frame_current}) for each in (frames, steps))
    keys = {frame: places[frame] for frame in frames}
    if _is_too_long(frames):
        return keys, None
    each = np.arange(frames[0], frames[-1] + 1.0)
    return keys, curve_positions(np.array(steps, dtype=np.float64), np.array([places[step] for step in steps]), each)


def _shown_along(scene: bpy.types.Scene, control: bpy.types.Object, frames: list[int]) -> Mapping[int, Array]:
    """Return frame -> location of a control in the evaluated scene."""
    found = {}
    with present_frame(scene):
        for frame in frames:
            scene.frame_set(frame)
            shown = control.evaluated_get(bpy.context.evaluated_depsgraph_get())
            found[frame] = np.array(shown.matrix_world.translation, dtype=np.float64)
    return found
