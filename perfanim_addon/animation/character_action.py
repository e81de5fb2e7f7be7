"""Motion of a character's own body, read from its keyed action and written back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ...core.body.motion import Motion
from ...core.errors import CharacterError
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array
from ...core.retarget.character_motion import own_body_plan, read_poses, readjusted
from ...core.retarget.retargeter import CharacterPose, RetargetPlan, apply_plan
from ..blender_versions import by_channel, curves_of, slot_of
from ..character.bone_map_settings import stored_adjustments
from ..character.own_body import own_body_plans
from .action_placement import fit_strips
from .actions import made_with, note_adjustments, present_frame, refill_pose, scene_fps
from .keyframes import bone_path
from .quaternion_curves import keep_in_quaternions

_SAME_STEP = 0.01  # largest difference between distances of keys that count as equal, frames


@dataclass(frozen=True)
class CharacterAction:
    """A character's keyed action as a motion.

    Args:
        frames: Scene frames (F,) of the poses, at a steady distance.
        plan: Plan from the character's own skeleton, with the adjustments that the keys were made with.
    """

    armature: str
    action: bpy.types.Action
    frames: Array
    motion: Motion
    plan: RetargetPlan


def keyed_action(armature_object: bpy.types.Object | None) -> bpy.types.Action | None:
    """Return the active action of a character, or None if there is none."""
    animation = armature_object.animation_data if armature_object is not None else None
    return animation.action if animation is not None else None


def read_character_action(armature_object: bpy.types.Object) -> CharacterAction:
    """Read the active action of a character.

    Raises:
        CharacterError: There is no action with keys for the character, or its root motion is not on the hips.
    """
    action = keyed_action(armature_object)
    advice = "in the Action Editor, choose the action, or put a take on the character"
    if action is None:
        raise CharacterError("has no active action", where=armature_object.name, advice=advice)
    if not action.is_editable:
        raise CharacterError("is linked from another file", where=action.name, advice="make the action local")
    (plan,) = own_body_plans(armature_object, [made_with(action)])
    own_body_plan(plan)
    _turn_by_quaternions(armature_object, plan.bones)
    curves = by_channel(curves_of(action, slot_of(armature_object.animation_data)))
    keyed = [curve for (path, _), curve in curves.items() if path in _paths(plan)]
    if not keyed:
        raise CharacterError("has no keys for this character", where=action.name, advice=advice)
    frames = _steady_frames(keyed)
    rotations, roots_m = read_poses(plan, _pose_at(armature_object, plan, curves, frames))
    fps = scene_fps(bpy.context.scene) / (float(frames[1] - frames[0]) if len(frames) > 1 else 1.0)
    return CharacterAction(
        armature_object.name, action, frames, Motion(action.name, fps, plan.skeleton, rotations, roots_m), plan
    )


def write_character_action(read: CharacterAction, motion: Motion, frames: Array) -> None:
    """Write a changed motion into its action: a key in each frame (F,).

    Curves of other bones and properties stay as they are.
    """
    plan, armature_object = own_body_plan(read.plan), bpy.data.objects[read.armature]
    pose = apply_plan(plan, motion.rotations, motion.root_positions_m)
    for _ in refill_pose(armature_object, read.action, frames, plan, pose):
        pass
    fit_strips(armature_object.animation_data, read.action, frames)


def readjust_action(armature_object: bpy.types.Object) -> None:
    """Change the keys of a character's active action to its present adjustments; CharacterError if it cannot."""
    action, wanted = keyed_action(armature_object), stored_adjustments(armature_object)
    if action is None or made_with(action) == wanted:
        return
    read = read_character_action(armature_object)
    before, after = own_body_plans(armature_object, [made_with(action), wanted])
    curves = by_channel(curves_of(action, slot_of(armature_object.animation_data)))
    pose = readjusted(before, after, _pose_at(armature_object, before, curves, read.frames))
    for _ in refill_pose(armature_object, action, read.frames, after, pose):
        pass
    note_adjustments(action, wanted)


def _turn_by_quaternions(armature_object: bpy.types.Object, bones: Sequence[str]) -> None:
    """Change the rotation mode of bones to quaternions, with their animation and present pose."""
    keep_in_quaternions(armature_object, bones)
    for name in bones:
        bone = armature_object.pose.bones[name]
        if bone.rotation_mode != "QUATERNION":
            turn = bone.matrix_basis.to_quaternion()
            bone.rotation_mode = "QUATERNION"
            bone.rotation_quaternion = turn


def _paths(plan: RetargetPlan) -> list[str]:
    return [bone_path(name, "rotation_quaternion") for name in plan.bones] + [
        bone_path(name, "location") for name in plan.located
    ]


def _steady_frames(curves: Sequence[bpy.types.FCurve]) -> Array:
    """Return the frames (F,) of the curve with the most keys if they are close and steady, else whole frames."""
    most = max(curves, key=lambda curve: len(curve.keyframe_points))
    keyed = np.empty(2 * len(most.keyframe_points), dtype=np.float32)
    most.keyframe_points.foreach_get("co", keyed)
    frames = np.sort(keyed[::2].astype(np.float64))
    steps = np.diff(frames)
    if len(steps) and steps.max() < 1.0 + _SAME_STEP and np.ptp(steps) < _SAME_STEP:
        return np.linspace(frames[0], frames[-1], len(frames))
    ends = [end for curve in curves for end in curve.range()]
    return np.arange(np.floor(min(ends)), np.ceil(max(ends)) + 1.0)


def _pose_at(
    armature_object: bpy.types.Object,
    plan: RetargetPlan,
    curves: Mapping[tuple[str, int], bpy.types.FCurve],
    frames: Array,
) -> CharacterPose:
    """Return the pose that an action shows in some frames; channels without a curve keep their present value."""
    bones = armature_object.pose.bones

    def values(name: str, channel: str) -> Array:
        now, path = getattr(bones[name], channel), bone_path(name, channel)
        found = np.empty((len(frames), len(now)))
        for component, still in enumerate(now):
            curve = curves.get((path, component))
            found[:, component] = still if curve is None else [curve.evaluate(frame) for frame in frames]
        return found

    rotations = np.stack([values(name, "rotation_quaternion") for name in plan.bones], axis=1)
    locations = np.stack([values(name, "location") for name in plan.located], axis=1)
    return CharacterPose(rot.normalize(rotations), locations, None, None)


def shown_pose(
    context: bpy.types.Context, armature_object: bpy.types.Object, plan: RetargetPlan, frames: Array
) -> CharacterPose:
    """Return the pose of a character in some scene frames, as action and NLA strips together show it."""
    rotations, locations = [], []
    with present_frame(context.scene):
        for frame in frames:
            context.scene.frame_set(int(np.floor(frame)), subframe=float(frame - np.floor(frame)))
            posed = armature_object.evaluated_get(context.evaluated_depsgraph_get()).pose.bones
            rotations.append([posed[name].matrix_basis.to_quaternion() for name in plan.bones])
            # copies, because the next frame changes what Blender hands out
            locations.append([posed[name].location.copy() for name in plan.located])
    return CharacterPose(np.array(rotations, dtype=np.float64), np.array(locations, dtype=np.float64), None, None)
