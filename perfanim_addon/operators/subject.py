"""Calibration of the performer."""

from pathlib import Path
from typing import Any

import bpy

from ...core.errors import SubjectError
from .. import capture_setup, states
from ..place import absolute, user_folder
from ..properties import settings
from .jobs import JobOperator

PANEL = "subject"
T_POSE_S = 2.0


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
        marker_set = states.marker_set_source(chosen)
        return ["calibrate", "subject", take, "--marker-set", marker_set, "--out", self._target]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the new subject."""
        settings(context).subject = self._target
        text = f"residual {float(summary.get('residual_mm', 0.0)):.0f} mm"
        # the other advice is about poses that cannot be recorded here
        return "; ".join((text, *(summary["advice"] if summary["verdict"] == "redo" else ())))


class PERFANIM_OT_record_t_pose(JobOperator, bpy.types.Operator):
    """Learn the empty room, count down, and record the performer who stands in the T pose; then calibrate from it"""

    bl_idname = "perfanim.record_t_pose"
    bl_label = "Record T Pose"
    title = "Recording the T pose"
    panel = PANEL

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs calibrated cameras and a marker set."""
        if not super().poll(context):
            return False
        chosen = settings(context)
        problem = states.cameras(chosen).problem or states.markers(chosen).problem
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def request(self, context: bpy.types.Context) -> dict[str, Any]:
        """Return what the worker is asked for."""
        chosen = settings(context)
        return {
            **capture_setup.cameras(chosen),
            "job": "record pose",
            "marker_set": states.marker_set_source(chosen),
            "countdown_s": chosen.countdown_s,
            "seconds": T_POSE_S,
            "out": str(user_folder("subjects") / "t-pose.take.npz"),
            "floor_out": str(user_folder("calibrations") / "cameras-on-floor.toml"),
        }

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the take, and the cameras with the floor that its feet showed."""
        chosen = settings(context)
        chosen.subject_take = summary["out"]
        if "calibration" in summary:
            chosen.calibration = summary["calibration"]
        text = f"{summary['frames']} frames of the T pose: calibrate now"
        return f"{text}; {summary['advice']}" if "advice" in summary else text


_CLASSES = (PERFANIM_OT_record_t_pose, PERFANIM_OT_calibrate_subject)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
