"""Recorded takes: recover, play, solve again, delete."""

import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.errors import PerfanimError, TakeError
from ...core.motion_files import read_motion
from ...core.skeleton import Skeleton
from ...core.solver.settings import METHODS
from ...core.take_file.lock import is_locked
from ...core.take_file.reading import ENDING, read_take_file, summarise
from .. import running, states, takes
from ..live import Array, pose_arrays, write_poses
from ..properties import settings
from . import common
from .jobs import JobOperator

PANEL = "takes"


def _chosen_path() -> bpy.types.StringProperty:
    return bpy.props.StringProperty(name="Take", description="File of the take", options={"HIDDEN", "SKIP_SAVE"})


def _put_on_character(
    context: bpy.types.Context, times_s: Array, rotations: Array, root_positions_m: Array, skeleton: Skeleton, name: str
) -> str:
    """Write poses as an action of the chosen armature, or of a new character; return the line that says so."""
    armature = settings(context).armature
    driven, start = armature.name if armature else "", float(context.scene.frame_current)
    action = write_poses(context, driven, times_s, rotations, root_positions_m, skeleton, start, name)
    return f"{len(times_s)} frames in {action} on {settings(context).armature.name}"


def _play(context: bpy.types.Context, path: Path) -> str:
    """Put a take as it was solved live onto the character; return the line that says so."""
    take = read_take_file(path)
    poses = [solved.pose for solved in take.poses]
    if not poses:
        raise TakeError("has no pose that was solved live", where=take.notes.name, advice="solve it again")
    skeleton = take.setup.worn_subject().skeleton
    text = _put_on_character(context, *pose_arrays(poses), skeleton, take.notes.name)
    takes.mark_played(path)
    unsolved = take.frame_count - len(poses)
    return f"{text}; {unsolved} more were not solved live: solve it again for them" if unsolved > 0 else text


class PERFANIM_OT_recover_take(JobOperator, bpy.types.Operator):
    """Write all that is intact of a take that was cut off as a whole take, and put its motion onto the character"""

    bl_idname = "perfanim.recover_take"
    bl_label = "Recover Take"
    bl_options = {"REGISTER", "UNDO"}
    title = "Recovering the take"
    panel = PANEL
    path: _chosen_path()

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        path = Path(self.path)
        name, count = path.name.removesuffix(ENDING), 1
        self._target = path.with_name(f"{name} recovered{ENDING}")
        while self._target.exists():
            count += 1
            self._target = path.with_name(f"{name} recovered {count}{ENDING}")
        return ["take", "recover", str(path), "--out", str(self._target)]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Set the cut file aside and play what was recovered."""
        path = Path(self.path)
        path.rename(path.with_name(path.name + takes.SET_ASIDE))
        takes.forget()
        text = f"{summary['frames']} frames recovered, {summary['duration_s']:.1f} s"
        return f"{text}; {_play(context, self._target)}" if summary["poses"] else f"{text}: solve them again"


class PERFANIM_OT_play_take(bpy.types.Operator):
    """Put a take onto the character as it was solved live, as an Action that begins at the current frame"""

    bl_idname = "perfanim.play_take"
    bl_label = "Put on Character"
    bl_options = {"REGISTER", "UNDO"}
    path: _chosen_path()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs."""
        return common.in_scene(cls, context) and common.idle(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the action."""
        try:
            text = _play(context, Path(self.path))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        running.set_message(PANEL, text)
        self.report({"INFO"}, text)
        return {"FINISHED"}


class PERFANIM_OT_solve_take(JobOperator, bpy.types.Operator):
    """Solve a take again from what its cameras saw, with the chosen motion database, and put it onto the character"""

    bl_idname = "perfanim.solve_take"
    bl_label = "Solve Again"
    bl_options = {"REGISTER", "UNDO"}
    title = "Solving the take"
    panel = PANEL
    path: _chosen_path()
    method: bpy.props.EnumProperty(
        name="Method",
        description="How poses are found",
        items=[(name, name, f"The method {name!r}") for name in METHODS],
        default="best",
    )

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        database = states.database_path(settings(context))
        self._folder = tempfile.TemporaryDirectory(prefix="perfanim-")
        self._target = Path(self._folder.name) / "solved.bvh"
        given = ["--database", str(database)] if database.exists() else []
        return ["solve", self.path, *given, "--method", self.method, "--out", str(self._target)]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Put the motion onto the character."""
        motion = read_motion(self._target)
        self._folder.cleanup()
        times_s, name = np.arange(motion.frames) / motion.fps, summarise(self.path).notes.name
        text = _put_on_character(context, times_s, motion.rotations, motion.root_positions_m, motion.skeleton, name)
        return "; ".join((text, *summary["warnings"]))


class PERFANIM_OT_delete_take(bpy.types.Operator):
    """Delete the file of a take for good; its Actions stay"""

    bl_idname = "perfanim.delete_take"
    bl_label = "Delete Take"
    path: _chosen_path()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs."""
        return common.idle(cls)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask first."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete."""
        path = Path(self.path)
        try:
            name = summarise(path).notes.name
            if is_locked(path):
                raise TakeError("is being recorded", where=name, advice="wait for the end of the capture")
            path.unlink()
        except OSError as error:
            return common.failed(self, PANEL, TakeError(f"cannot be deleted ({error.strerror})", where=str(path)))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        takes.forget()
        running.set_message(PANEL, f"{name} deleted")
        return {"FINISHED"}


_CLASSES = (PERFANIM_OT_recover_take, PERFANIM_OT_play_take, PERFANIM_OT_solve_take, PERFANIM_OT_delete_take)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
