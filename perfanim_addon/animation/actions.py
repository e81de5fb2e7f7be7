"""Actions written from recorded poses and from the motion of objects."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import astuple

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ...core.body.skeleton import Skeleton
from ...core.errors import CharacterError
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array
from ...core.retarget.character_fit import Adjustments
from ...core.retarget.retargeter import CharacterPose, RetargetPlan, apply_plan
from ..blender_versions import by_channel, curves_of, first_slot, slot_of
from ..character.armature_reading import clear_offsets, delta_transforms
from ..character.bone_map_settings import stored_adjustments
from ..character.create_character import find_armature
from ..character.retarget_plans import plan_for
from .action_placement import Placement, PlacementMode, new_action, place_action
from .keyframes import KeyWriter, bone_path, fill, is_hand_pose
from .quaternion_curves import keep_in_quaternions

_OBJECT_GROUP = "Object Transforms"  # name used by Blender
_ADJUSTED = "perfanim_adjustments"  # custom property of an action: the adjustments that its keys were made with
_NEW = Placement()


def scene_frames(times_s: ArrayLike, scene: bpy.types.Scene, start_frame: float = 1.0) -> Array:
    """Return scene frames for times (F,) in seconds, starting at `start_frame`."""
    times = np.asarray(times_s, dtype=np.float64)
    return start_frame + (times - times[0]) * scene_fps(scene) if len(times) else times


def scene_fps(scene: bpy.types.Scene) -> float:
    """Return the scene's frames per second."""
    return float(scene.render.fps) / float(scene.render.fps_base)


@contextmanager
def present_frame(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore the scene's current frame on exit."""
    frame, part = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=part)


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
        object_name: Name of the armature object.
        frames: Scene frame (F,) of each pose, strictly increasing, fractions allowed (see `scene_frames`).
        rotations: Parent-from-joint quaternions (F, J, 4) relative to the rest pose.
        root_positions_m: Root (F, 3) in the capture space.
        placement: Where the action goes, the bones that it moves, and the bounds for key reduction.

    Returns:
        The action's name (Blender may append ".001").

    Raises:
        CharacterError: The armature is missing or cannot be driven, none of its bones would be moved, or poses are not
            finite.
    """
    armature_object = find_armature(object_name)
    at, q, positions = (np.asarray(each, dtype=np.float64) for each in (frames, rotations, root_positions_m))
    if not (np.all(np.isfinite(q)) and np.all(np.isfinite(positions))):
        raise CharacterError("the poses contain numbers that are not finite", advice="solve the take again")
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
    """Write poses according to a retarget plan; otherwise like `write_action`."""
    animation = armature_object.animation_data or armature_object.animation_data_create()
    if animation.use_tweak_mode:
        advice = "leave tweak mode (Tab in the NLA editor)"
        raise CharacterError("one of its NLA strips is being edited", where=armature_object.name, advice=advice)
    turned = _moved(plan.bones, placement.only)
    moved = _moved(plan.located, placement.only)
    if not turned and not moved:
        advice = "select mapped bones in Pose Mode, or write all bones"
        raise CharacterError("none of the selected bones would be moved", where=armature_object.name, advice=advice)
    pose = apply_plan(plan, rotations, root_positions_m)
    keep_in_quaternions(armature_object, turned)
    clear_offsets(armature_object, turned, moved)
    for bone_name in turned:
        armature_object.pose.bones[bone_name].rotation_mode = "QUATERNION"
    action = new_action(animation, name, placement.onto)
    quaternions, signs, blend = rot.continuous(pose.rotations), np.ones((2, len(turned))), 0.0
    if placement.onto is PlacementMode.LAYER:
        blend = placement.blend_s * scene_fps(bpy.context.scene)
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
    note_adjustments(action, stored_adjustments(armature_object))
    place_action(animation, action, frames, placement.onto, blend)
    return str(action.name)


def write_object_action(
    target: bpy.types.Object, frames: Array, rotations: Array, locations: Array, *, name: str, placement: Placement
) -> str:
    """Write the motion of an object in its parent's space as a new action; return the action's name.

    The object's rotation mode becomes quaternion; its strip does not blend.
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
    """Return bone -> index for the bones to write."""
    return {name: place for place, name in enumerate(bones) if only is None or name in only}


def _signs(armature_object: bpy.types.Object, turned: dict[str, int], quaternions: Array, frames: Array) -> Array:
    """Return the signs (2, B) that bring the first and last rotations nearest to the animation in the tracks below.

    q and -q are the same rotation, but blending from one to the other is a full turn.
    """
    signs = np.ones((2, len(turned)))
    for row, end in enumerate((0, -1)):
        below = _quaternions_at(armature_object, list(turned), float(frames[end]))
        facing = np.sum(below * quaternions[end, list(turned.values())], axis=-1)
        signs[row] = np.where(facing < 0.0, -1.0, 1.0)
    return signs


def _quaternions_at(armature_object: bpy.types.Object, bones: list[str], frame: float) -> Array:
    """Return the rotations (B, 4) of bones in a frame of the scene."""
    scene = bpy.context.scene
    with present_frame(scene):
        scene.frame_set(int(np.floor(frame)), subframe=frame - np.floor(frame))
        evaluated = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found = np.array([evaluated.pose.bones[name].rotation_quaternion for name in bones], dtype=np.float64)
    return found.reshape(-1, 4)


def is_keyed_in_each_frame(action: bpy.types.Action) -> bool:
    """Return whether each curve has a key in each frame; False without curves."""
    ends = [(each.range(), len(each.keyframe_points)) for each in curves_of(action, first_slot(action))]
    return bool(ends) and all(round(span[1] - span[0]) + 1 == count for span, count in ends)


def refill_action(
    armature_object: bpy.types.Object,
    action: bpy.types.Action,
    frames: Array,
    rotations: Array,
    root_positions_m: Array,
    plan: RetargetPlan,
) -> Iterator[None]:
    """Set a key in each frame of an action's curves; yield after each bone. Arguments as in `write_with_plan`."""
    yield from refill_pose(armature_object, action, frames, plan, apply_plan(plan, rotations, root_positions_m))


def refill_pose(
    armature_object: bpy.types.Object,
    action: bpy.types.Action,
    frames: Array,
    plan: RetargetPlan,
    pose: CharacterPose,
) -> Iterator[None]:
    """Set a key of a character's pose in each frame of an action's curves; yield after each bone."""
    animation = armature_object.animation_data
    slot = slot_of(animation) if animation is not None and animation.action == action else first_slot(action)
    curves = by_channel(curves_of(action, slot))
    quaternions = rot.continuous(pose.rotations)
    channels = [(bone_path(name, "rotation_quaternion"), quaternions[:, i]) for i, name in enumerate(plan.bones)]
    channels += [(bone_path(name, "location"), pose.locations[:, i]) for i, name in enumerate(plan.located)]
    if pose.object_rotation is not None and pose.object_location is not None:
        turns, ways = delta_transforms(armature_object, pose.object_rotation, pose.object_location)
        channels += [("delta_rotation_quaternion", rot.continuous(turns)), ("delta_location", ways)]
    for path, values in channels:
        for component, channel in enumerate(values.T):
            curve = curves.get((path, component))
            if curve is not None and not is_hand_pose(curve):
                curve.keyframe_points.clear()
                fill(curve, frames, channel, straight=True)
        yield


def note_adjustments(action: bpy.types.Action, adjustments: Adjustments) -> None:
    """Store the adjustments that an action's keys were made with."""
    if made_with(action) != adjustments:
        action[_ADJUSTED] = list(astuple(adjustments))


def made_with(action: bpy.types.Action) -> Adjustments:
    """Return the adjustments that an action's keys were made with."""
    kept = action.get(_ADJUSTED)
    return Adjustments(*map(float, kept)) if kept is not None and len(kept) == 4 else Adjustments()
