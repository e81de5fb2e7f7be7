"""Actions: recorded poses as keyframes, on every supported Blender (channels on the action up to 4.3, slots from 4.4).

The one module that knows how actions are built inside: `Action.fcurves` is gone in Blender 5.0, slots came in 4.4.
"""

from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import rotations as rot
from ..core.errors import CharacterError
from ..core.skeleton import Skeleton
from .character import find_armature
from .posing import Posing, posing_of
from .retarget_rig import delta_transforms

Array = NDArray[np.float64]

HAS_SLOTS = bpy.app.version >= (4, 4, 0)
_OBJECT_GROUP = "Object Transforms"  # as Blender calls it
_LINEAR = 1  # Keyframe.interpolation "LINEAR" as foreach_set takes it
_LINEAR_ROTATION_FRAMES = 2.0  # mean key distance up to which straight lines between keys show no corners


def scene_frames(times_s: ArrayLike, scene: bpy.types.Scene, start_frame: float = 1.0) -> Array:
    """Return scene frames (fractions allowed) of times (F,) in seconds: the first time falls on `start_frame`."""
    times = np.asarray(times_s, dtype=np.float64)
    return start_frame + (times - times[0]) * scene_fps(scene) if len(times) else times


def scene_fps(scene: bpy.types.Scene) -> float:
    """Return the scene's frames per second."""
    return float(scene.render.fps) / float(scene.render.fps_base)


def write_action(
    object_name: str,
    frames: ArrayLike,
    rotations: ArrayLike,
    root_positions_m: ArrayLike,
    skeleton: Skeleton,
    *,
    name: str = "Capture",
) -> str:
    """Write poses as a new action of an armature and assign it; the action that was there is kept in the file.

    Args:
        object_name: an armature object, driven as `posing_of` tells.
        frames: (F,) scene frame of each pose, strictly increasing, fractions allowed (see `scene_frames`).
        rotations: (F, J, 4) parent-from-joint quaternions relative to rest.
        root_positions_m: (F, 3) root in product space.
        skeleton: the skeleton that the poses are relative to.
        name: wished name of the action.

    Returns:
        The action's name (Blender may append ".001").

    Raises:
        CharacterError: no such armature, one that cannot be driven, no poses, or arrays that do not belong together.
    """
    armature_object = find_armature(object_name)
    at = np.asarray(frames, dtype=np.float64)
    q = np.asarray(rotations, dtype=np.float64)
    positions = np.asarray(root_positions_m, dtype=np.float64)
    _check(at, q, positions, skeleton)
    return write_posing(armature_object, at, q, positions, posing_of(armature_object, skeleton), name=name)


def write_posing(
    armature_object: bpy.types.Object,
    frames: Array,
    rotations: Array,
    root_positions_m: Array,
    posing: Posing,
    *,
    name: str,
) -> str:
    """Write poses through a given posing as a new action; arguments and result otherwise as of `write_action`."""
    pose = posing.pose(rotations, root_positions_m)
    for bone_name in posing.bones:
        armature_object.pose.bones[bone_name].rotation_mode = "QUATERNION"
    action = _new_action(armature_object, name)
    channels = _writable_channels(action, armature_object)
    straight = len(frames) < 2 or float(np.mean(np.diff(frames))) <= _LINEAR_ROTATION_FRAMES

    def add(path: str, group: str, values: Array) -> None:
        for component in range(values.shape[1]):
            _fill(_new_curve(channels, path, component, group), frames, values[:, component], straight)

    quaternions = rot.continuous(pose.rotations)
    for place, bone_name in enumerate(posing.bones):
        add(_bone_path(bone_name, "rotation_quaternion"), bone_name, quaternions[:, place])
    for place, bone_name in enumerate(posing.located):
        add(_bone_path(bone_name, "location"), bone_name, pose.locations[:, place])
    if pose.object_rotation is not None and pose.object_location is not None:
        turns, ways = delta_transforms(armature_object, pose.object_rotation, pose.object_location)
        add("delta_rotation_quaternion", _OBJECT_GROUP, rot.continuous(turns))
        add("delta_location", _OBJECT_GROUP, ways)
    return str(action.name)


def _check(frames: Array, rotations: Array, positions: Array, skeleton: Skeleton) -> None:
    count = len(frames)
    if count == 0:
        raise CharacterError("there are no frames to write", advice="record something first")
    if rotations.shape != (count, len(skeleton), 4) or positions.shape != (count, 3):
        raise CharacterError(
            f"{count} frames of {len(skeleton)} joints cannot have arrays {rotations.shape} and {positions.shape}"
        )
    if np.any(np.diff(frames) <= 0.0):
        first = int(np.argmax(np.diff(frames) <= 0.0))
        raise CharacterError("the frames' times do not increase", where=f"pose {first + 1}")
    if not (np.all(np.isfinite(rotations)) and np.all(np.isfinite(positions)) and np.all(np.isfinite(frames))):
        raise CharacterError("poses must be finite numbers")


def _new_action(armature_object: bpy.types.Object, name: str) -> bpy.types.Action:
    """Create an action and make it the object's own; an earlier one keeps a fake user, so saving does not drop it."""
    animation = armature_object.animation_data or armature_object.animation_data_create()
    if animation.action is not None:
        animation.action.use_fake_user = True
    action = bpy.data.actions.new(name)
    action.use_fake_user = True
    animation.action = action
    if HAS_SLOTS:
        animation.action_slot = action.slots.new(id_type="OBJECT", name=armature_object.name)
    return action


def _writable_channels(action: bpy.types.Action, armature_object: bpy.types.Object) -> Any:
    """Return what new curves are added to: the slot's channel bag, or before 4.4 the action itself."""
    if not HAS_SLOTS:
        return action
    strip = action.layers.new("Layer").strips.new(type="KEYFRAME")
    return strip.channelbag(armature_object.animation_data.action_slot, ensure=True)


def _new_curve(channels: Any, path: str, component: int, group: str) -> bpy.types.FCurve:
    if not HAS_SLOTS:
        return channels.fcurves.new(path, index=component, action_group=group)
    curve = channels.fcurves.new(path, index=component)
    curve.group = channels.groups.get(group) or channels.groups.new(group)
    return curve


def _fill(curve: bpy.types.FCurve, frames: Array, values: Array, straight: bool) -> None:
    points = curve.keyframe_points
    points.add(len(frames))
    points.foreach_set("co", np.stack((frames, values), axis=1).astype(np.float32).ravel())
    if straight:
        points.foreach_set("interpolation", np.full(len(frames), _LINEAR, dtype=np.int32))
    curve.update()


def _bone_path(bone_name: str, channel: str) -> str:
    return f'pose.bones["{bpy.utils.escape_identifier(bone_name)}"].{channel}'


def curves_of(armature_object: bpy.types.Object) -> list[bpy.types.FCurve]:
    """Return the animation curves of the object's assigned action (of its slot from 4.4), empty without one."""
    animation = armature_object.animation_data
    if animation is None or animation.action is None:
        return []
    if not HAS_SLOTS:
        return list(animation.action.fcurves)
    slot = animation.action_slot
    bags = [
        strip.channelbag(slot)
        for layer in animation.action.layers
        for strip in layer.strips
        if slot is not None and strip.type == "KEYFRAME"
    ]
    return [curve for bag in bags if bag is not None for curve in bag.fcurves]
