"""Write poses into an action at once, from arrays."""

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.body.scene_pose import PerformerPose
from ...core.body.skeleton import Skeleton
from ..animation.actions import scene_frames, write_action
from ..character.create_character import create_character
from ..character.free_place import free_place, look_at
from ..settings.capture_settings import settings
from ..settings.result_settings import placement

Array = NDArray[np.float64]


LEAST_STEP_S = 1e-4


def add_character(context: bpy.types.Context, skeleton: Skeleton) -> str:
    """Add a character of these proportions beside what stands in the scene, choose it, show it, return its name."""
    place = free_place(context)
    name = create_character(context, skeleton)
    character = bpy.data.objects[name]
    character.location = place
    settings(context).armature = character
    look_at(context, place)
    return name


def pose_arrays(poses: Sequence[PerformerPose]) -> tuple[Array, Array, Array]:
    """Return times (F,) in seconds, rotations (F, J, 4) and root positions (F, 3) in metres of poses."""
    times_s = np.array([pose.time_s for pose in poses])
    return times_s, np.stack([p.rotations for p in poses]), np.stack([p.root_position_m for p in poses])


def write_poses(
    context: bpy.types.Context,
    object_name: str,
    times_s: Array,
    rotations: Array,
    root_positions_m: Array,
    skeleton: Skeleton,
    start_frame: float,
    name: str,
    only: frozenset[str] | None = None,
) -> str:
    """Write poses onto an armature, or a new character where that is gone, as is chosen; return the action's name.

    Args:
        times_s: (F,) the first stands at `start_frame`, t seconds later is `start_frame` + t * the scene's frames per
            second.
        rotations, root_positions_m: (F, J, 4), (F, 3) as `write_action` takes them.
        skeleton: the performer's.
        name: wished name of the action.
        only: bones that are written, None for all; the others keep the animation that they have.

    Raises:
        CharacterError: the armature cannot be driven, or there are no poses.
    """
    if object_name not in bpy.data.objects:
        object_name, only = add_character(context, skeleton), None
    frames = scene_frames(increasing(times_s), context.scene, start_frame)
    chosen = placement(context, bpy.data.objects.get(object_name), only)
    action = write_action(object_name, frames, rotations, root_positions_m, skeleton, name=name, placement=chosen)
    if settings(context).extend_scene:
        context.scene.frame_end = max(context.scene.frame_end, int(np.ceil(frames[-1])))
    return action


def frames_of(context: bpy.types.Context, poses: Sequence[PerformerPose], start_frame: float) -> Array:
    """Return the scene frames (F,) on which poses stand, of which the first is at `start_frame`."""
    return scene_frames(increasing(np.array([pose.time_s for pose in poses])), context.scene, start_frame)


def increasing(times_s: Array) -> Array:
    """Return times (F,) with those that do not come after their predecessor moved to 0.1 ms behind it."""
    ramp = LEAST_STEP_S * np.arange(len(times_s))
    return np.maximum.accumulate(times_s - ramp) + ramp
