"""Operators that clean up the motion of a character's active action."""

from abc import abstractmethod
from typing import Any

import bpy
import numpy as np

from ...core.body.looping import looped, repeated
from ...core.body.motion import Motion, sliced
from ...core.body.motion_edits import mirrored, smoothed, t_pose_end, without_pop
from ...core.body.moved_feet import hold_planted
from ...core.body.standing_on_floor import on_floor
from ...core.errors import SettingsError, counted
from ...core.geometry.arrays import Array
from ..animation.character_action import (
    CharacterAction,
    keyed_action,
    read_character_action,
    write_character_action,
)
from ..panels.clean_up_panel import KEY as PANEL
from ..preferences.property_kinds import number, switch, whole_number
from ..settings.capture_settings import settings
from .operator_bases import UndoOperator

_FARTHEST = 1_000_000  # Blender's last frame


def _frame(name: str, description: str) -> Any:
    return whole_number(name, description, 1, -_FARTHEST, _FARTHEST, options={"SKIP_SAVE"})


class _CleanUpOperator(UndoOperator):
    """Base of the operators; the redo panel changes their values."""

    panel = PANEL

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        armature_object = settings(context).armature
        if armature_object is None:
            return "Choose a character first"
        return "" if keyed_action(armature_object) is not None else "The character has no active action"

    def run(self, context: bpy.types.Context) -> str:
        read = read_character_action(settings(context).armature)
        if hasattr(self, "first") and not self.properties.is_property_set("first"):
            self.propose(context.scene, read)
        motion, frames = self.edited(read)
        write_character_action(read, motion, frames)
        return f"{self.bl_label}: {self.told(frames)} of {read.action.name}"

    def told(self, frames: Array) -> str:
        """Return what the message says was changed; `frames` (F,) are those of the changed motion."""
        return f"frames {frames[0]:g} to {frames[-1]:g}"

    def propose(self, scene: bpy.types.Scene, read: CharacterAction) -> None:
        """Set the frames that a click on the button means; the redo panel then changes them."""

    @abstractmethod
    def edited(self, read: CharacterAction) -> tuple[Motion, Array]:
        """Return the changed motion and the scene frame (F,) of each of its poses; PerfanimError if it cannot be."""


class _RangeOperator(_CleanUpOperator):
    """Base of operators on a range: the preview range, or else frames around the playhead."""

    around = 0  # frames on each side of the playhead; 0 for the whole action

    def propose(self, scene: bpy.types.Scene, read: CharacterAction) -> None:
        if scene.use_preview_range:
            self.first, self.last = scene.frame_preview_start, scene.frame_preview_end
        elif self.around:
            self.first, self.last = scene.frame_current - self.around, scene.frame_current + self.around
        else:
            self.first, self.last = int(np.ceil(read.frames[0])), int(read.frames[-1])

    def rows(self, read: CharacterAction) -> tuple[int, int]:
        """Return the first and last row of the chosen frames; an empty range gives first > last."""
        inside = np.flatnonzero((read.frames >= self.first - 1e-3) & (read.frames <= self.last + 1e-3))
        return (int(inside[0]), int(inside[-1])) if len(inside) else (0, -1)


class _PartOperator(_RangeOperator):
    """Base of operators that change nothing outside of the range."""

    def told(self, frames: Array) -> str:
        return f"frames {self.first} to {self.last}"


class PERFANIM_OT_trim_motion(_RangeOperator, bpy.types.Operator):
    """Remove the beginning and the end of the motion; a T pose at the start is proposed"""

    bl_label = "Trim"
    first: _frame("First", "First frame that is kept")
    last: _frame("Last", "Last frame that is kept")

    def propose(self, scene: bpy.types.Scene, read: CharacterAction) -> None:
        super().propose(scene, read)
        if not scene.use_preview_range:
            self.first = int(np.ceil(read.frames[t_pose_end(read.motion)]))

    def edited(self, read: CharacterAction) -> tuple[Motion, Array]:
        first, last = self.rows(read)
        if last - first < 1:
            raise SettingsError("nothing of the motion would be left", advice="choose frames of the action")
        return sliced(read.motion, first, last + 1), read.frames[first : last + 1]


class PERFANIM_OT_shift_motion(_CleanUpOperator, bpy.types.Operator):
    """Move the motion in time, to begin at the playhead"""

    bl_label = "Shift in Time"
    first: _frame("Start", "Frame at which the motion begins")

    def propose(self, scene: bpy.types.Scene, read: CharacterAction) -> None:
        self.first = scene.frame_current

    def edited(self, read: CharacterAction) -> tuple[Motion, Array]:
        return read.motion, read.frames - read.frames[0] + self.first


class PERFANIM_OT_loop_motion(_RangeOperator, bpy.types.Operator):
    """Find one cycle of a walk, match its start and end, and repeat it"""

    bl_label = "Loop"
    first: _frame("First", "First frame to look for a cycle in")
    last: _frame("Last", "Last frame to look for a cycle in")
    times: whole_number("Times", "How often the cycle is repeated", 4, 1, 1000)

    def told(self, frames: Array) -> str:
        return f"{counted(self.times, 'cycle')}, {super().told(frames)}"

    def edited(self, read: CharacterAction) -> tuple[Motion, Array]:
        first, last = self.rows(read)
        if last - first < 2:
            raise SettingsError("no frames of the motion lie in the range", advice="choose frames of the action")
        motion = repeated(looped(sliced(read.motion, first, last + 1)), self.times)
        step = read.frames[1] - read.frames[0]
        return motion, read.frames[0] + step * np.arange(motion.frames)


class PERFANIM_OT_mirror_motion(_CleanUpOperator, bpy.types.Operator):
    """Exchange left and right, from the same place and heading"""

    bl_label = "Mirror"

    def edited(self, read: CharacterAction) -> tuple[Motion, Array]:
        return mirrored(read.motion), read.frames


class PERFANIM_OT_smooth_motion(_PartOperator, bpy.types.Operator):
    """Smooth the preview range, or else the whole motion"""

    bl_label = "Smooth"
    first: _frame("First", "First frame to smooth")
    last: _frame("Last", "Last frame to smooth")
    smoothing_ms: number("Smoothing (ms)", "Width of the filter: larger is smoother", 60.0, 1.0, 1000.0)
    feet: switch("Hold Feet", "Keep standing feet in place", default=True)

    def edited(self, read: CharacterAction) -> tuple[Motion, Array]:
        motion = smoothed(read.motion, *self.rows(read), 0.001 * self.smoothing_ms)
        return hold_planted(motion) if self.feet else motion, read.frames


class PERFANIM_OT_remove_pop(_PartOperator, bpy.types.Operator):
    """Replace the frames around the playhead, or the preview range, by a smooth path"""

    bl_label = "Remove Pop"
    around = 2
    first: _frame("First", "First frame that is replaced")
    last: _frame("Last", "Last frame that is replaced")

    def edited(self, read: CharacterAction) -> tuple[Motion, Array]:
        return without_pop(read.motion, *self.rows(read)), read.frames


class PERFANIM_OT_hold_feet(_CleanUpOperator, bpy.types.Operator):
    """Hold standing feet in place"""

    bl_label = "Hold Feet"
    floor: switch("On Floor", "Stand the soles exactly on the floor, too", default=True)

    def edited(self, read: CharacterAction) -> tuple[Motion, Array]:
        motion = on_floor(read.motion) if self.floor else read.motion
        return hold_planted(motion), read.frames
