"""Actions written from a take's motion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import bpy
import numpy as np

from ...core.body.clock import Clock, clock_of, poses_at
from ...core.body.foot_lock import floor_of
from ...core.body.scene_pose import DOUBTFUL, PerformerPose, ScenePose
from ...core.formats.take_file.take_reader import TakeFile
from ...core.geometry.arrays import Array, Mask
from ...core.markers.prop import Prop
from ...core.retarget.retargeter import RetargetPlan
from ...core.session.pose_filters import FilterSettings, filter_poses
from ..animation.action_placement import Placement, PlacementMode
from ..animation.actions import scene_fps, write_action, write_object_action, write_with_plan
from ..character.create_character import find_armature
from ..character.part_bones import part_of_bones
from ..character.retarget_plans import plan_for
from ..settings import target_settings
from ..settings.capture_settings import settings
from ..settings.result_settings import placement
from .capture_space import CaptureSpace
from .performer_targets import PerformerTarget


@dataclass(frozen=True)
class TakeMotion:
    """Filtered motion of a whole take or capture."""

    performers: Sequence[PerformerTarget]  # in the order of the poses
    props: Sequence[Prop]  # in the order of the poses
    poses: Sequence[ScenePose]  # all, because those outside the recorded parts show where a performer was first seen


@dataclass(frozen=True)
class RecordedPart:
    """Poses that become keyframes at a steady rate, and the scene frame of the first one."""

    poses: Sequence[ScenePose]
    start_frame: float

    @cached_property
    def clock(self) -> Clock:
        """Clock of the poses; a single pose lasts a second."""
        return clock_of(np.array([pose.time_s for pose in self.poses]), stated_fps=1.0)

    def steady(self, performer: int, first: int = 0) -> "_SteadyPoses":
        """Return the poses of a performer, from the `first` one on, at the steady rate."""
        clock = self.clock.part(first, len(self.poses)) if first else self.clock
        poses = [pose.performers[performer] for pose in self.poses[first:]]
        rotations, roots_m = np.stack([p.rotations for p in poses]), np.stack([p.root_position_m for p in poses])
        nearest = [poses[row] for row in clock.nearest]
        return _SteadyPoses(self.frames(clock), *clock.poses(rotations, roots_m), nearest)

    def frames(self, clock: Clock) -> Array:
        """Return the scene frames (N,) of a clock's steady times."""
        return self.start_frame + (clock.steady_s - self.clock.times_s[0]) * scene_fps(bpy.context.scene)


@dataclass(frozen=True)
class _SteadyPoses:
    """Poses of a performer at a steady rate, in scene frames (N,), with the solved pose nearest to each."""

    frames: Array
    rotations: Array
    root_positions_m: Array
    nearest: Sequence[PerformerPose]


def filter_take(take: TakeFile, chosen: FilterSettings, use_stored: bool = True) -> list[ScenePose]:
    """Return all poses of a take, filtered.

    Args:
        chosen: Settings for a take without stored settings, or whose stored settings are not used.
        use_stored: Whether the settings stored in the take take precedence.
    """
    stored = take.notes.filters if use_stored else None
    return filter_poses(
        [solved.pose for solved in take.poses],
        [subject.skeleton for subject in take.setup.subjects()],
        floor_of(take.setup.camera_rig()),
        chosen if stored is None else FilterSettings.of_table(stored),
    )


def write_take(
    context: bpy.types.Context, motion: TakeMotion, parts: Sequence[RecordedPart], title: str
) -> tuple[str, list[str]]:
    """Write parts of a take as actions of the characters and objects.

    Args:
        title: Name of the actions; for props and further performers their own name is added.

    Returns:
        The first performer's character, added if missing, and the actions' names.

    Raises:
        CharacterError: A character or object cannot be animated.
    """
    main, *further = motion.performers
    main = main.ensure_character(context, None)
    character, skeleton = bpy.data.objects[main.armature], main.subject.skeleton
    actions = []
    for part in parts:
        poses, how = part.steady(main.index), placement(context, character, main.only)
        rows, how = _chosen_keys(context, poses, how, character, plan_for(character, skeleton))
        keyed = poses.frames[rows], poses.rotations[rows], poses.root_positions_m[rows]
        actions.append(write_action(main.armature, *keyed, skeleton, name=title, placement=how))
        if settings(context).extend_scene:
            context.scene.frame_end = max(context.scene.frame_end, int(np.ceil(poses.frames[-1])))
    if motion.props or further:
        character = find_armature(main.armature)
        writer = _FurtherWriter(context, motion, CaptureSpace(character, plan_for(character, skeleton)), title)
        for part in parts:
            for index, prop in enumerate(motion.props):
                actions += writer.prop(index, prop, part)
            for target in further:
                actions += writer.performer(target, part)
    return main.armature, actions


@dataclass(frozen=True)
class _FurtherWriter:
    """Writes the actions of props and further performers."""

    context: bpy.types.Context
    motion: TakeMotion
    space: CaptureSpace
    title: str

    def prop(self, index: int, prop: Prop, part: RecordedPart) -> list[str]:
        """Write the action of a prop's object, with keys in frames where the prop was found."""
        clock, poses = part.clock, part.poses
        found = np.array([len(pose.props) > index and pose.props[index].found for pose in poses])
        known, keyed = found[clock.rows], found[clock.nearest]
        if not keyed.any():
            return []
        seen = [poses[row].props[index] for row in clock.rows[known]]
        turns, places_m = np.array([pose.rotation for pose in seen]), np.array([pose.position_m for pose in seen])
        moved = self.space.to_scene(*poses_at(clock.times_s[known], turns, places_m, clock.steady_s[keyed]))
        target = bpy.data.objects[target_settings.object_of(self.context, prop)]
        target_settings.check_object(target)
        chosen = placement(self.context, None)
        onto = PlacementMode.STRIP if chosen.onto is PlacementMode.LAYER else chosen.onto
        how = Placement(onto, None, chosen.bounds)
        name = f"{self.title} {prop.name}"
        return [write_object_action(target, part.frames(clock)[keyed], *moved, name=name, placement=how)]

    def performer(self, target: PerformerTarget, part: RecordedPart) -> list[str]:
        """Write the action of a further performer's character, from the first pose in which the performer is seen."""
        timed = part.clock.rows
        seen = target.first_seen([part.poses[row] for row in timed])
        if seen is None:
            return []
        is_new = target.character() is None
        target = target.ensure_character(self.context, self.space)
        character, subject = bpy.data.objects[target.armature], target.subject
        plan = plan_for(character, subject.skeleton)
        how = placement(self.context, None if is_new else character, target.only)
        if how.only is not None and not how.only & {*plan.bones, *plan.located}:
            return []
        poses = part.steady(target.index, int(timed[seen]))
        rows, how = _chosen_keys(self.context, poses, how, character, plan)
        offset = target.offset_into(self.space, CaptureSpace(character, plan), self.motion.poses)
        moved = offset.apply(poses.rotations[rows], poses.root_positions_m[rows])
        name = f"{self.title} {subject.name}"
        return [write_with_plan(character, poses.frames[rows], *moved, plan, name=name, placement=how)]


def _chosen_keys(
    context: bpy.types.Context, poses: _SteadyPoses, how: Placement, character: bpy.types.Object, plan: RetargetPlan
) -> tuple[Mask, Placement]:
    """Return a mask (N,) of the poses that get keys, and the placement with the doubtful frames."""
    doubtful = np.array([pose.confidence < DOUBTFUL for pose in poses.nearest])
    leave_out = context.scene.perfanim_result.doubtful != "MARK"
    parts: dict[str, list[float]] = {}
    for frame, pose in zip(poses.frames, poses.nearest, strict=True):
        for part in pose.doubtful_parts:
            parts.setdefault(part, []).append(frame)
    by_bone = part_of_bones(character, plan) if parts else {}
    of_bones = {bone: parts[part] for bone, part in by_bone.items() if part in parts}
    how = replace(how, doubtful=of_bones, leave_out=leave_out)
    if not leave_out:
        return np.ones(len(doubtful), dtype=np.bool_), replace(how, marked=tuple(poses.frames[doubtful]))
    kept = ~doubtful
    kept[[0, -1]] = True  # the take keeps its length
    return kept, how
