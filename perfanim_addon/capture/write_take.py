"""Motion of a take written as actions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.body.foot_lock import floor_of
from ...core.body.scene_pose import DOUBTFUL, ScenePose
from ...core.formats.take_file.take_reader import TakeFile
from ...core.geometry.arrays import Array, Mask
from ...core.markers.prop import Prop
from ...core.retarget.retargeter import RetargetPlan
from ...core.session.pose_filters import FilterSettings, filter_poses
from ..animation.action_placement import Placement, PlacementMode
from ..animation.actions import scene_frames, write_action, write_object_action, write_with_plan
from ..character.create_character import find_armature
from ..character.part_bones import part_of_bones
from ..character.retarget_plans import plan_for
from ..settings import target_settings
from ..settings.capture_settings import settings
from ..settings.result_settings import placement
from .capture_space import CaptureSpace
from .performer_targets import PerformerTarget
from .tuning import TUNING


@dataclass(frozen=True)
class TakeMotion:
    """Filtered motion of a whole take or capture."""

    performers: Sequence[PerformerTarget]  # in the order of the poses
    props: Sequence[Prop]  # in the order of the poses
    poses: Sequence[ScenePose]  # all, because those outside the recorded parts show where a performer was first seen


@dataclass(frozen=True)
class RecordedPart:
    """Poses that become keyframes, and the scene frame of the first one."""

    poses: Sequence[ScenePose]
    start_frame: float


def filter_take(take: TakeFile, chosen: FilterSettings, use_stored: bool = True) -> list[ScenePose]:
    """Return all poses of a take, filtered with its stored settings, if any, else with the chosen ones."""
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
    frames = [_scene_frames(context, part) for part in parts]
    actions = []
    for part, at in zip(parts, frames, strict=True):
        how = placement(context, character, main.only)
        rows, how = _chosen_keys(context, part.poses, at, how, character, plan_for(character, skeleton))
        _, rotations, roots = pose_arrays(part.poses)
        actions.append(
            write_action(main.armature, at[rows], rotations[rows], roots[rows], skeleton, name=title, placement=how)
        )
        if settings(context).extend_scene:
            context.scene.frame_end = max(context.scene.frame_end, int(np.ceil(at[-1])))
    if motion.props or further:
        character = find_armature(main.armature)
        writer = _FurtherWriter(context, motion, CaptureSpace(character, plan_for(character, skeleton)), title)
        for part, at in zip(parts, frames, strict=True):
            for index, prop in enumerate(motion.props):
                actions += writer.prop(index, prop, part, at)
            for target in further:
                actions += writer.performer(target, part, at)
    return main.armature, actions


@dataclass(frozen=True)
class _FurtherWriter:
    """Writes the actions of props and further performers."""

    context: bpy.types.Context
    motion: TakeMotion
    space: CaptureSpace
    title: str

    def prop(self, index: int, prop: Prop, part: RecordedPart, frames: Array) -> list[str]:
        """Write the action of a prop's object, with keys in frames where the prop was found."""
        rows = [row for row, pose in enumerate(part.poses) if len(pose.props) > index and pose.props[index].found]
        if not rows:
            return []
        found = [part.poses[row].props[index] for row in rows]
        rotations, locations = self.space.to_scene(
            np.array([pose.rotation for pose in found]), np.array([pose.position_m for pose in found])
        )
        target = bpy.data.objects[target_settings.object_of(self.context, prop)]
        target_settings.check_object(target)
        chosen = placement(self.context, None)
        onto = PlacementMode.STRIP if chosen.onto is PlacementMode.LAYER else chosen.onto
        how = Placement(onto, None, chosen.bounds)
        name = f"{self.title} {prop.name}"
        return [write_object_action(target, frames[rows], rotations, locations, name=name, placement=how)]

    def performer(self, target: PerformerTarget, part: RecordedPart, frames: Array) -> list[str]:
        """Write the action of a further performer's character, from the first pose in which the performer is seen."""
        first = target.first_seen(part.poses)
        if first is None:
            return []
        is_new = target.character() is None
        target = target.ensure_character(self.context, self.space)
        character, subject = bpy.data.objects[target.armature], target.subject
        plan = plan_for(character, subject.skeleton)
        how = placement(self.context, None if is_new else character, target.only)
        if how.only is not None and not how.only & {*plan.bones, *plan.located}:
            return []
        poses, frames = part.poses[first:], frames[first:]
        rows, how = _chosen_keys(self.context, poses, frames, how, character, plan, target.index)
        _, rotations, roots = pose_arrays(poses, target.index)
        offset = target.offset_into(self.space, CaptureSpace(character, plan), self.motion.poses)
        moved = offset.apply(rotations[rows], roots[rows])
        name = f"{self.title} {subject.name}"
        return [write_with_plan(character, frames[rows], *moved, plan, name=name, placement=how)]


def _chosen_keys(
    context: bpy.types.Context,
    poses: Sequence[ScenePose],
    frames: Array,
    how: Placement,
    character: bpy.types.Object,
    plan: RetargetPlan,
    performer: int = 0,
) -> tuple[Mask, Placement]:
    """Return the poses (F,) that get keys, and the placement with the doubtful frames."""
    performed = [pose.performers[performer] for pose in poses]
    doubtful = np.array([pose.confidence < DOUBTFUL for pose in performed])
    leave_out = context.scene.perfanim_result.doubtful != "MARK"
    parts: dict[str, list[float]] = {}
    for frame, pose in zip(frames, performed, strict=True):
        for part in pose.doubtful_parts:
            parts.setdefault(part, []).append(frame)
    by_bone = part_of_bones(character, plan) if parts else {}
    of_bones = {bone: parts[part] for bone, part in by_bone.items() if part in parts}
    how = replace(how, doubtful=of_bones, leave_out=leave_out)
    if not leave_out:
        return np.ones(len(poses), dtype=np.bool_), replace(how, marked=tuple(frames[doubtful]))
    kept = ~doubtful
    kept[[0, -1]] = True  # the take keeps its length
    return kept, how


def _scene_frames(context: bpy.types.Context, part: RecordedPart) -> Array:
    times_s = np.array([pose.time_s for pose in part.poses])
    return scene_frames(increasing(times_s), context.scene, part.start_frame)


def pose_arrays(poses: Sequence[ScenePose], performer: int = 0) -> tuple[Array, Array, Array]:
    """Return times (F,), rotations (F, J, 4) and root positions (F, 3) of a performer."""
    found = [pose.performers[performer] for pose in poses]
    times_s = np.array([pose.time_s for pose in found])
    return times_s, np.stack([p.rotations for p in found]), np.stack([p.root_position_m for p in found])


def increasing(times_s: Array) -> Array:
    """Return times (F,), each at least 0.1 ms after its predecessor."""
    ramp = TUNING.least_step_s * np.arange(len(times_s))
    return np.maximum.accumulate(times_s - ramp) + ramp
