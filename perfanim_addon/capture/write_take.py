"""Write a take's motion as actions: the one function behind the end of a capture and Put on Character."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.body.foot_lock import floor_of
from ...core.body.scene_pose import ScenePose
from ...core.body.skeleton import Skeleton
from ...core.formats.take_file.reading import TakeFile
from ...core.markers.prop import Prop
from ...core.session.pose_filters import FilterSettings, filter_poses
from ..animation.actions import scene_frames, write_action
from ..character.create_character import create_character, find_armature
from ..character.free_place import find_free_position, look_at
from ..character.posing import plan_for
from ..settings.capture_settings import settings
from ..settings.result_settings import placement
from .capture_space import CaptureSpace
from .performer_driver import Role, write_performer_actions
from .prop_driver import write_prop_actions

Array = NDArray[np.float64]

LEAST_STEP_S = 1e-4


@dataclass(frozen=True)
class TakeMotion:
    """Filtered motion of a whole take or capture.

    Args:
        skeleton: the first performer's.
        props, performers: in the order of the poses' props and others.
        poses: all of them, also those outside the recorded part: they show where somebody was first seen.
    """

    skeleton: Skeleton
    props: Sequence[Prop]
    performers: Sequence[Role]
    poses: Sequence[ScenePose]


@dataclass(frozen=True)
class RecordedPart:
    """Poses that become keyframes, and the scene frame of the first; the others follow at their times."""

    poses: Sequence[ScenePose]
    start_frame: float


def filter_take(take: TakeFile, chosen: FilterSettings, use_stored: bool = True) -> list[ScenePose]:
    """Return all poses of a take, filtered as in its capture; takes without stored settings, by the chosen ones."""
    stored = take.notes.filters if use_stored else None
    return filter_poses(
        [solved.pose for solved in take.poses],
        [subject.skeleton for subject in take.setup.subjects()],
        floor_of(take.setup.camera_rig()),
        chosen if stored is None else FilterSettings.of_table(stored),
    )


def write_take(
    context: bpy.types.Context,
    motion: TakeMotion,
    parts: Sequence[RecordedPart],
    title: str,
    armature: str,
    only: frozenset[str] | None = None,
) -> tuple[str, list[str]]:
    """Write parts of a take as actions of the characters and objects; return the character and the actions' names.

    Args:
        motion: the take.
        parts: to write, one action each.
        title: of the actions; those of props and further performers add the name.
        armature: the first performer's character; a new one is added where it is gone.
        only: bones that get keyframes, None for all; the others keep their animation.

    Raises:
        CharacterError: a character or object cannot be animated, or there are no poses.
    """
    if armature not in bpy.data.objects:
        armature, only = add_character(context, motion.skeleton), None
    frames = [_scene_frames(context, part) for part in parts]
    actions = []
    for part, at in zip(parts, frames, strict=True):
        how = placement(context, bpy.data.objects[armature], only)
        arrays = pose_arrays(part.poses)[1:]
        actions.append(write_action(armature, at, *arrays, motion.skeleton, name=title, placement=how))
        if settings(context).extend_scene:
            context.scene.frame_end = max(context.scene.frame_end, int(np.ceil(at[-1])))
    if motion.props or motion.performers:
        space = CaptureSpace(find_armature(armature), plan_for(find_armature(armature), motion.skeleton))
        for part, at in zip(parts, frames, strict=True):
            how = placement(context, None)
            actions += write_prop_actions(context, motion.props, part.poses, at, space, title, how)
            actions += write_performer_actions(context, motion.performers, motion.poses, part.poses, at, space, title)
    return armature, actions


def _scene_frames(context: bpy.types.Context, part: RecordedPart) -> Array:
    times_s = np.array([pose.time_s for pose in part.poses])
    return scene_frames(increasing(times_s), context.scene, part.start_frame)


def pose_arrays(poses: Sequence[ScenePose], performer: int = 0) -> tuple[Array, Array, Array]:
    """Return times (F,) in seconds, rotations (F, J, 4) and root positions (F, 3) in metres of one performer."""
    found = [pose.performers[performer] for pose in poses]
    times_s = np.array([pose.time_s for pose in found])
    return times_s, np.stack([p.rotations for p in found]), np.stack([p.root_position_m for p in found])


def increasing(times_s: Array) -> Array:
    """Return times (F,) with those that do not come after their predecessor moved to 0.1 ms behind it."""
    ramp = LEAST_STEP_S * np.arange(len(times_s))
    return np.maximum.accumulate(times_s - ramp) + ramp


def add_character(context: bpy.types.Context, skeleton: Skeleton) -> str:
    """Add a character of these proportions in a free position, choose it, show it, return its name."""
    place = find_free_position(context)
    name = create_character(context, skeleton)
    character = bpy.data.objects[name]
    character.location = place
    settings(context).armature = character
    look_at(context, place)
    return name
