"""Operators that put takes on the character."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ...core.body.scene_pose import ScenePose
from ...core.errors import PerfanimError, TakeError, counted
from ...core.formats.take_file.take_reader import TakeFile, read_take_file, take_name, unused_path
from .. import take_library
from ..capture import capture_request
from ..capture.performer_targets import copy_targets, performer_targets
from ..capture.write_take import RecordedPart, TakeMotion, doubts, filter_take, show_reference, write_take
from ..panels.takes_panel import KEY as PANEL
from ..preferences.property_kinds import HIDDEN, string
from ..settings.capture_settings import settings
from ..settings.result_settings import start_frame
from .job_operators import JobOperator
from .operator_bases import PanelOperator


class TakeOperator:
    """Base of the operators for one take."""

    bl_options = {"REGISTER", "UNDO"}
    panel = PANEL
    path: string("Take", "File of the take", options=HIDDEN)


def take_motion(context: bpy.types.Context, take: TakeFile) -> TakeMotion:
    """Return a take's filtered motion with its characters; TakeError if it is not solved."""
    if not take.poses:
        raise TakeError("has no solved poses", where=take.notes.name, advice="click Solve Again")
    chosen = capture_request.shape(settings(context))
    poses = filter_take(take, chosen, use_stored=context.scene.perfanim_result.filters == "RECORDED")
    subjects = take.setup.subjects()
    copies = copy_targets(context, subjects[0])
    return TakeMotion(performer_targets(context, subjects), take.setup.carried_props(), poses, copies)


def recorded_poses(take: TakeFile, motion: TakeMotion) -> list[ScenePose]:
    """Return the poses of the recorded part of a take; TakeError if there are none."""
    poses = [pose for pose in motion.poses if take.is_recorded(pose.number)]
    if not poses:
        raise TakeError("has no solved poses", where=take.notes.name, advice="click Solve Again")
    return poses


def put_on_character(context: bpy.types.Context, path: Path) -> tuple[str, tuple[str, ...]]:
    """Write a take to the chosen or new characters and objects; return the line to show, and the actions' names."""
    take = read_take_file(path)
    motion = take_motion(context, take)
    poses = recorded_poses(take, motion)
    part = RecordedPart(poses, start_frame(context))
    name, actions = write_take(context, motion, [part], take.notes.name)
    take_library.mark_played(path, name)
    text = f"{counted(len(poses), 'frame')} in {', '.join(actions)} on {name}{doubts(motion, [part])}"
    unsolved = take.frame_count - len(take.poses)
    if context.scene.perfanim_result.pictures:
        text += "; " + _reference(context, take, name, motion, part)
    text += f"; {counted(unsolved, 'more frame')} without a pose: use Solve Again" * (unsolved > 0)
    return text, tuple(actions)


def _reference(
    context: bpy.types.Context, take: TakeFile, character: str, motion: TakeMotion, part: RecordedPart
) -> str:
    """Show a take's reference pictures; return a sentence on where they are, or why there are none."""
    if context.scene.perfanim_result.continue_here:
        return "no reference pictures: the take was turned and moved to continue another one"
    main = replace(motion.performers[0], armature=character)
    try:
        return f"pictures behind {', '.join(show_reference(context, take, main, part))}"
    except PerfanimError as error:
        return f"no reference pictures: {error}"


class PERFANIM_OT_play_take(TakeOperator, PanelOperator, bpy.types.Operator):
    """Write the take onto the character as an action, NLA strip or layer"""

    bl_label = "Put on Character"

    def run(self, context: bpy.types.Context) -> str:
        text, self.about = put_on_character(context, Path(self.path))
        return text


class PERFANIM_OT_recover_take(TakeOperator, JobOperator, bpy.types.Operator):
    """Save the intact part of an unfinished take, and put it onto the character"""

    bl_label = "Recover Take"
    title = "Recovering the take"

    def arguments(self, context: bpy.types.Context) -> list[str]:
        path = Path(self.path)
        self._target = unused_path(path.parent, f"{take_name(path)} recovered")
        return ["take", "recover", str(path), "--out", str(self._target)]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        path = Path(self.path)
        path.rename(path.with_name(path.name + take_library.RECOVERED_SUFFIX))
        take_library.forget()
        text = f"{counted(summary['frames'], 'frame')} recovered, {summary['duration_s']:.1f} s"
        if not summary["poses"]:
            return f"{text}: use Solve Again"
        put, self.about = put_on_character(context, self._target)
        return f"{text}; {put}"
