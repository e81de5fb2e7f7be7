"""Actions: recorded poses, and how objects moved, as keyframes."""

from collections.abc import Collection, Iterator

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ...core.body.skeleton import Skeleton
from ...core.errors import CharacterError
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array
from ...core.retarget.retargeter import RetargetPlan, apply_plan
from ..character.armature_reading import clear_offsets, delta_transforms
from ..character.create_character import find_armature
from ..character.posing import plan_for
from .action_placement import BLEND_S, Placement, PlacementMode, new_action, place_action
from .channels import HAS_SLOTS, channels_of
from .keyframes import KeyWriter, bone_path, fill
from .quaternion_curves import keep_in_quaternions

_OBJECT_GROUP = "Object Transforms"  # as Blender calls it
_NEW = Placement()


def scene_frames(times_s: ArrayLike, scene: bpy.types.Scene, start_frame: float = 1.0) -> Array:
    """Return scene frames of times (F,) in seconds, the first at `start_frame`."""
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
    placement: Placement = _NEW,
) -> str:
    """Write poses as a new action of an armature; its old action stays in the file.

    Args:
        object_name: an armature object, driven as `plan_for` returns it.
        frames: (F,) scene frame of each pose, strictly increasing, fractions allowed (see `scene_frames`).
        rotations: (F, J, 4) parent-from-joint quaternions relative to rest.
        root_positions_m: (F, 3) root in product space.
        placement: where it goes, which bones it moves, how many keys it has.

    Returns:
        The action's name (Blender may append ".001").

    Raises:
        CharacterError: no such armature, one that cannot be driven, no poses, arrays that do not belong together, or
            none of the bones is to be moved.
    """
    armature_object = find_armature(object_name)
    at = np.asarray(frames, dtype=np.float64)
    q = np.asarray(rotations, dtype=np.float64)
    positions = np.asarray(root_positions_m, dtype=np.float64)
    _check(at, q, positions, skeleton)
    return write_with_plan(
        armature_object, at, q, positions, plan_for(armature_object, skeleton), name=name, placement=placement
    )


def write_with_plan(
    armature_object: bpy.types.Object,
    frames: Array,
    rotations: Array,
    root_positions_m: Array,
    plan: RetargetPlan,
    *,
    name: str,
    placement: Placement = _NEW,
) -> str:
    """Write poses by a given retarget plan; otherwise as `write_action`."""
    animation = armature_object.animation_data or armature_object.animation_data_create()
    if animation.use_tweak_mode:
        advice = "leave tweak mode (Tab in the NLA editor)"
        raise CharacterError("a strip of it is being edited", where=armature_object.name, advice=advice)
    turned = _moved(plan.bones, placement.only)
    moved = _moved(plan.located, placement.only)
    if not turned and not moved:
        advice = "select bones of the map in Pose Mode, or write all"
        raise CharacterError("none of the bones that would move is selected", where=armature_object.name, advice=advice)
    pose = apply_plan(plan, rotations, root_positions_m)
    keep_in_quaternions(armature_object, turned)
    clear_offsets(armature_object, turned, moved)
    for bone_name in turned:
        armature_object.pose.bones[bone_name].rotation_mode = "QUATERNION"
    action = new_action(animation, name, placement.onto)
    quaternions, signs, blend = rot.continuous(pose.rotations), np.ones((2, len(turned))), 0.0
    if placement.onto is PlacementMode.LAYER:
        blend = BLEND_S * scene_fps(bpy.context.scene)
        signs = _signs(armature_object, turned, quaternions, frames)
    how = (placement.bounds, placement.marked, placement.doubtful, placement.leave_out)
    writer = KeyWriter(armature_object, action, frames, *how)
    for (bone_name, place), ends in zip(turned.items(), signs.T, strict=True):
        writer.rotate(bone_path(bone_name, "rotation_quaternion"), bone_name, quaternions[:, place], ends)
    for bone_name, place in moved.items():
        writer.move(bone_path(bone_name, "location"), bone_name, pose.locations[:, place])
    if pose.object_rotation is not None and pose.object_location is not None and placement.only is None:
        turns, ways = delta_transforms(armature_object, pose.object_rotation, pose.object_location)
        writer.rotate("delta_rotation_quaternion", _OBJECT_GROUP, rot.continuous(turns))
        writer.move("delta_location", _OBJECT_GROUP, ways)
    place_action(animation, action, frames, placement.onto, blend)
    return str(action.name)


def write_object_action(
    target: bpy.types.Object, frames: Array, rotations: Array, locations: Array, *, name: str, placement: Placement
) -> str:
    """Write the motion of an object as a new action of it; return the action's name.

    Args:
        target: is switched to quaternions.
        frames: (F,) scene frames, strictly increasing.
        rotations, locations: (F, 4), (F, 3) in its parent's space.
        placement: where it goes and how many keys it has; a strip of an object does not blend.
    """
    animation = target.animation_data or target.animation_data_create()
    target.rotation_mode = "QUATERNION"
    action = new_action(animation, name, placement.onto)
    writer = KeyWriter(target, action, frames, placement.bounds)
    writer.rotate("rotation_quaternion", _OBJECT_GROUP, rot.continuous(rotations))
    writer.move("location", _OBJECT_GROUP, locations)
    place_action(animation, action, frames, placement.onto, blend=0.0)
    return str(action.name)


def _moved(bones: tuple[str, ...], only: Collection[str] | None) -> dict[str, int]:
    """Return the bones to be written, each with its place among all."""
    return {name: place for place, name in enumerate(bones) if only is None or name in only}


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


def _signs(armature_object: bpy.types.Object, turned: dict[str, int], quaternions: Array, frames: Array) -> Array:
    """Return signs (2, B) of the first and last rotations, nearest to the animation.

    q and -q are the same, but a blend between one and the other goes round.
    """
    signs = np.ones((2, len(turned)))
    for row, end in enumerate((0, -1)):
        below = _quaternions_at(armature_object, list(turned), float(frames[end]))
        facing = np.sum(below * quaternions[end, list(turned.values())], axis=-1)
        signs[row] = np.where(facing < 0.0, -1.0, 1.0)
    return signs


def _quaternions_at(armature_object: bpy.types.Object, bones: list[str], frame: float) -> Array:
    """Return the rotations (B, 4) of bones at a frame of the scene."""
    scene = bpy.context.scene
    before = scene.frame_current_final
    scene.frame_set(int(np.floor(frame)), subframe=frame - np.floor(frame))
    evaluated = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    found = np.array([evaluated.pose.bones[name].rotation_quaternion for name in bones], dtype=np.float64)
    scene.frame_set(int(np.floor(before)), subframe=before - np.floor(before))
    return found.reshape(-1, 4)


def is_keyed_in_each_frame(action: bpy.types.Action) -> bool:
    """Return whether each curve has a key in each frame; False without curves."""
    slot = action.slots[0] if HAS_SLOTS and len(action.slots) else None
    curves = [curve for bag in channels_of(action, slot) for curve in bag.fcurves]
    ends = [(each.range(), len(each.keyframe_points)) for each in curves]
    return bool(ends) and all(round(span[1] - span[0]) + 1 == count for span, count in ends)


def refill_action(
    armature_object: bpy.types.Object,
    action: bpy.types.Action,
    frames: Array,
    rotations: Array,
    root_positions_m: Array,
    plan: RetargetPlan,
) -> Iterator[None]:
    """Set a key in each frame of the curves that an action has; yield after each bone.

    Args:
        frames, rotations, root_positions_m, plan: as of `write_with_plan`.
    """
    slot = action.slots[0] if HAS_SLOTS else None
    curves = {(each.data_path, each.array_index): each for bag in channels_of(action, slot) for each in bag.fcurves}
    pose = apply_plan(plan, rotations, root_positions_m)
    quaternions = rot.continuous(pose.rotations)
    channels = [(bone_path(name, "rotation_quaternion"), quaternions[:, i]) for i, name in enumerate(plan.bones)]
    channels += [(bone_path(name, "location"), pose.locations[:, i]) for i, name in enumerate(plan.located)]
    if pose.object_rotation is not None and pose.object_location is not None:
        turns, ways = delta_transforms(armature_object, pose.object_rotation, pose.object_location)
        channels += [("delta_rotation_quaternion", rot.continuous(turns)), ("delta_location", ways)]
    for path, values in channels:
        for component, channel in enumerate(values.T):
            if (path, component) in curves:
                curve = curves[path, component]
                curve.keyframe_points.clear()
                fill(curve, frames, channel, straight=True)
        yield
