"""A take that continues the animation that a character already has."""

from dataclasses import dataclass

import bpy
import numpy as np

from ...core.body.motion import Motion
from ...core.body.seams import continued
from ...core.geometry.arrays import Array
from ...core.retarget.character_motion import own_body_plan, read_poses
from ...core.retarget.retargeter import RetargetPlan, apply_plan
from ..animation.actions import scene_fps
from ..animation.character_action import shown_pose
from ..character.bone_map_settings import stored_adjustments
from ..character.own_body import own_body_plans


@dataclass(frozen=True)
class OwnMotion:
    """A motion of a character's own body, and the plan that writes it."""

    plan: RetargetPlan
    motion: Motion


def continue_animation(
    context: bpy.types.Context, armature_object: bpy.types.Object, plan: RetargetPlan, take: Motion, frames: Array
) -> OwnMotion:
    """Return a take that begins with the place, heading and pose that a character has in the take's first frame.

    Args:
        plan: Plan from the performer to the character.
        take: The take's motion, at a steady rate.
        frames: Its scene frames (F,).

    Raises:
        SettingsError: The take has one frame.
        CharacterError: The character's root motion is not on the hips.
    """
    (own,) = own_body_plans(armature_object, [stored_adjustments(armature_object)])
    writer = own_body_plan(own)
    step = float(frames[1] - frames[0]) if len(frames) > 1 else 1.0
    before = frames[0] + step * np.array([-2.0, -1.0, 0.0])
    shown = read_poses(own, shown_pose(context, armature_object, own, before))
    made = read_poses(own, apply_plan(plan, take.rotations, take.root_positions_m))
    ends, starts = (Motion(take.name, take.fps, own.skeleton, *poses) for poses in (shown, made))
    blend_s = context.scene.perfanim_result.blend_frames / scene_fps(context.scene)
    return OwnMotion(writer, continued(ends, starts, blend_s))
