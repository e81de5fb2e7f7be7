"""Actions written from a take's motion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import bpy
import numpy as np

from ...core.body.clock import CLOCK, Clock, clock_of, poses_at
from ...core.body.foot_lock import floor_of
from ...core.body.motion import Motion
from ...core.body.moved_feet import floor_height_m
from ...core.body.scene_pose import DOUBTFUL, PerformerPose, ScenePose
from ...core.body.skeleton import Skeleton
from ...core.body.standing_on_floor import on_floor
from ...core.formats.take_file.take_reader import TakeFile
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array, Mask
from ...core.markers.prop import Prop
from ...core.markers.subject import Subject
from ...core.retarget.retargeter import RetargetPlan
from ...core.session.doubtful_text import doubtful_text
from ...core.session.pose_filters import FilterSettings, filter_poses
from ..animation.action_placement import Placement, PlacementMode
from ..animation.actions import scene_fps, scene_frames, write_object_action, write_with_plan
from ..character.part_bones import part_of_bones
from ..character.retarget_plans import plan_for
from ..settings import target_settings
from ..settings.capture_settings import settings
from ..settings.result_settings import placement
from .capture_space import CaptureSpace, RigidOffset
from .continue_take import OwnMotion, continue_animation
from .performer_targets import PerformerTarget
from .reference_pictures import show_pictures

_NO_OFFSET = RigidOffset(rot.identity(), np.zeros(3))


@dataclass(frozen=True)
class TakeMotion:
    """Filtered motion of a whole take or capture."""

    performers: Sequence[PerformerTarget]  # in the order of the poses
    props: Sequence[Prop]  # in the order of the poses
    poses: Sequence[ScenePose]  # all, because those outside the recorded parts show where a performer was first seen
    copies: Sequence[PerformerTarget] = ()  # further characters of the first performer


@dataclass(frozen=True)
class RecordedPart:
    """Poses that become keyframes at a steady rate, and the scene frame of the first one."""

    poses: Sequence[ScenePose]
    start_frame: float

    @cached_property
    def clock(self) -> Clock:
        """Clock of the poses; a single pose lasts a second."""
        scene = bpy.context.scene
        clock = clock_of(np.array([pose.time_s for pose in self.poses]), stated_fps=1.0)
        return clock.at(scene_fps(scene)) if scene.perfanim_result.whole_frames else clock

    def steady(self, performer: int, first: int = 0) -> "_SteadyPoses":
        """Return the poses of a performer, from the `first` one on, at the steady rate."""
        clock = self.clock
        known = clock.rows >= first
        shown = clock.steady_s >= clock.times_s[known][0] - CLOCK.same / clock.fps
        poses = [pose.performers[performer] for pose in self.poses]
        if clock.is_whole and not first:
            rotations, roots_m = _stacked(poses)
        else:
            wanted_s = np.maximum(clock.steady_s[shown], clock.times_s[known][0])
            rotations, roots_m = poses_at(
                clock.times_s[known], *_stacked([poses[row] for row in clock.rows[known]]), wanted_s
            )
        nearest = [poses[max(row, first)] for row in clock.nearest[shown]]
        return _SteadyPoses(self.frames(clock)[shown], clock.fps, rotations, roots_m, nearest)

    def frames(self, clock: Clock) -> Array:
        """Return the scene frames (N,) of a clock's steady times."""
        return self.start_frame + (clock.steady_s - self.clock.times_s[0]) * scene_fps(bpy.context.scene)


def _stacked(poses: Sequence[PerformerPose]) -> tuple[Array, Array]:
    return np.stack([pose.rotations for pose in poses]), np.stack([pose.root_position_m for pose in poses])


@dataclass(frozen=True)
class _SteadyPoses:
    """Poses of a performer at a steady rate, in scene frames (N,), with the solved pose nearest to each."""

    frames: Array
    fps: float
    rotations: Array
    root_positions_m: Array
    nearest: Sequence[PerformerPose]

    def motion(self, skeleton: Skeleton) -> Motion:
        """Return the poses as a motion."""
        return Motion("take", self.fps, skeleton, self.rotations, self.root_positions_m)


@dataclass(frozen=True)
class _Placing:
    """Where a take goes in the capture space of the first character.

    Args:
        floor_m: Height of the take's floor if standing feet are put on it, else None.
        offset: Offset of the take; without the height of the floor.
    """

    floor_m: float | None
    offset: RigidOffset

    @classmethod
    def of(cls, context: bpy.types.Context, poses: _SteadyPoses, skeleton: Skeleton, space: CaptureSpace) -> "_Placing":
        """Return the placing chosen in the result settings, for the first performer's poses."""
        chosen = context.scene.perfanim_result
        turn = rot.from_rotation_vector(np.array([0.0, chosen.turn, 0.0]))
        start_m = poses.root_positions_m[0] * [1.0, 0.0, 1.0]
        shift_m = space.points_from_scene(chosen.offset) - space.points_from_scene(np.zeros(3))
        offset = RigidOffset(turn, start_m - rot.rotate(turn, start_m) + shift_m)
        return cls(floor_height_m(poses.motion(skeleton)) if chosen.on_floor else None, offset)

    def of_performer(self, poses: _SteadyPoses, skeleton: Skeleton) -> _SteadyPoses:
        """Return the poses of a performer in their place."""
        motion = poses.motion(skeleton)
        motion = motion if self.floor_m is None else on_floor(motion, self.floor_m)
        rotations, roots_m = self.offset.apply(motion.rotations, motion.root_positions_m)
        return replace(poses, rotations=rotations, root_positions_m=roots_m)

    def of_prop(self, rotations: Array, positions_m: Array) -> tuple[Array, Array]:
        """Return the rotations (F, 4) and positions (F, 3) of a prop in their place."""
        return self.offset.apply_to_prop(rotations, positions_m - [0.0, self.floor_m or 0.0, 0.0])


def filter_take(take: TakeFile, chosen: FilterSettings, use_stored: bool = True) -> list[ScenePose]:
    """Return all poses of a take, filtered.

    Args:
        chosen: Settings for a take without stored settings, or whose stored settings are not used.
        use_stored: Whether the settings stored in the take take precedence.
    """
    stored = take.notes.filters if use_stored else None
    return filter_poses(
        [solved.pose for solved in take.poses],
        take.setup.subjects(),
        floor_of(take.setup.camera_rig()),
        chosen if stored is None else FilterSettings.of_table(stored),
    )


def doubts(motion: TakeMotion, parts: Sequence[RecordedPart]) -> str:
    """Return a sentence on the scene frames with doubtful poses or missing targets, and why; "" if there are none."""
    performers, props = [each.subject.name for each in motion.performers], [prop.name for prop in motion.props]
    told = []
    for part in parts:
        frames = scene_frames([pose.time_s for pose in part.poses], bpy.context.scene, part.start_frame)
        told.append(doubtful_text(part.poses, performers, props, frames))
    text = "; ".join(filter(None, told))
    return f". Doubtful: {text}" if text else ""


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
    plan, space, placing = _placed(context, main, parts[0])
    actions = []
    for part in parts:
        poses = placing.of_performer(part.steady(main.index), skeleton)
        rows, how = _chosen_keys(context, poses, placement(context, character, main.only), character, plan)
        shown = OwnMotion(plan, poses.motion(skeleton))
        if context.scene.perfanim_result.continue_here and character.animation_data is not None:
            shown = continue_animation(context, character, plan, shown.motion, poses.frames)
        keyed = poses.frames[rows], shown.motion.rotations[rows], shown.motion.root_positions_m[rows]
        actions.append(write_with_plan(character, *keyed, shown.plan, name=title, placement=how))
        if settings(context).extend_scene:
            context.scene.frame_end = max(context.scene.frame_end, int(np.ceil(poses.frames[-1])))
    if motion.props or further or motion.copies:
        writer = _FurtherWriter(context, motion, space, placing, title)
        for part in parts:
            for index, prop in enumerate(motion.props):
                actions += writer.prop(index, prop, part)
            for target in further:
                actions += writer.performer(target, part)
            for target in motion.copies:
                actions += writer.copy(target, part)
    return main.armature, actions


def _placed(
    context: bpy.types.Context, main: PerformerTarget, part: RecordedPart
) -> tuple[RetargetPlan, CaptureSpace, _Placing]:
    """Return the plan of the first performer's character, the capture space there, and the place of a take in it."""
    character, skeleton = bpy.data.objects[main.armature], main.subject.skeleton
    plan = plan_for(character, skeleton)
    space = CaptureSpace(character, plan)
    return plan, space, _Placing.of(context, part.steady(main.index), skeleton, space)


def show_reference(context: bpy.types.Context, take: TakeFile, main: PerformerTarget, part: RecordedPart) -> list[str]:
    """Show a written take's films or pictures; arguments and errors are those of `show_pictures`."""
    _, space, placing = _placed(context, main, part)

    def to_scene(turns: Array, places_m: Array) -> tuple[Array, Array]:
        return space.to_scene(*placing.of_prop(turns, places_m))

    return show_pictures(context, take, [pose.time_s for pose in part.poses], part.start_frame, to_scene)


@dataclass(frozen=True)
class _FurtherWriter:
    """Writes the actions of props and further performers."""

    context: bpy.types.Context
    motion: TakeMotion
    space: CaptureSpace
    placing: _Placing
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
        placed = self.placing.of_prop(*poses_at(clock.times_s[known], turns, places_m, clock.steady_s[keyed]))
        moved = self.space.to_scene(*placed)
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
        offset = target.offset_into(self.space, CaptureSpace(character, plan), self.motion.poses)
        poses = part.steady(target.index, int(timed[seen]))
        return self._write(character, plan, poses, subject, how, offset, f"{self.title} {subject.name}")

    def copy(self, target: PerformerTarget, part: RecordedPart) -> list[str]:
        """Write the action of a further character of the first performer, which stays where it stands."""
        character, subject = target.character(), target.subject
        if character is None:
            return []
        plan = plan_for(character, subject.skeleton)
        how, name = placement(self.context, character, target.only), f"{self.title} {character.name}"
        return self._write(character, plan, part.steady(target.index), subject, how, _NO_OFFSET, name)

    def _write(
        self,
        character: bpy.types.Object,
        plan: RetargetPlan,
        poses: _SteadyPoses,
        subject: Subject,
        how: Placement,
        offset: RigidOffset,
        name: str,
    ) -> list[str]:
        if how.only is not None and not how.only & {*plan.bones, *plan.located}:
            return []
        poses = self.placing.of_performer(poses, subject.skeleton)
        rows, how = _chosen_keys(self.context, poses, how, character, plan)
        moved = offset.apply(poses.rotations[rows], poses.root_positions_m[rows])
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
