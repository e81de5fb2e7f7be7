"""Calibration of the performer."""

from pathlib import Path
from typing import Any

import bpy

from ...core.errors import SubjectError
from ..place import absolute, user_folder
from ..properties import settings
from .jobs import JobOperator

PANEL = "subject"


class PERFANIM_OT_calibrate_subject(JobOperator, bpy.types.Operator):
    """Find bone lengths and marker places from a marker take that begins with the performer standing in a T pose"""

    bl_idname = "perfanim.calibrate_subject"
    bl_label = "Calibrate from T Pose"
    title = "Calibrating the performer"
    panel = PANEL

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs a take."""
        if not super().poll(context):
            return False
        if not settings(context).subject_take:
            cls.poll_message_set("Choose a marker take that begins with a T pose")
            return False
        return True

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        chosen = settings(context)
        take = absolute(chosen.subject_take)
        if not Path(take).is_file():
            raise SubjectError("not found", where=take, advice="choose a marker take")
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in chosen.subject_name) or "performer"
        self._target = str(user_folder("subjects") / f"{name}.toml")
        marker_set = absolute(chosen.marker_set_file) or chosen.marker_set
        return ["calibrate", "subject", take, "--marker-set", marker_set, "--out", self._target]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the new subject."""
        settings(context).subject = self._target
        return f"residual {float(summary.get('residual_mm', 0.0)):.0f} mm"


_CLASSES = (PERFANIM_OT_calibrate_subject,)


def register() -> None:
    """Register the operators."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
