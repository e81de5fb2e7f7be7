"""Calibration of the cameras."""

from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from ...core.errors import CalibrationError, PerfanimError
from .. import running, states
from ..place import absolute, user_folder
from ..properties import settings
from . import common
from .jobs import JobOperator

PANEL = "cameras"


class PERFANIM_OT_calibrate_cameras(JobOperator, bpy.types.Operator):
    """Find lenses and places of the two cameras from images of a chessboard, taken at the same moments by both"""

    bl_idname = "perfanim.calibrate_cameras"
    bl_label = "Calibrate with Board"
    title = "Calibrating the cameras"
    panel = PANEL

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs a folder of each camera."""
        if not super().poll(context):
            return False
        chosen = settings(context)
        if not (chosen.board_left and chosen.board_right):
            cls.poll_message_set("Choose the folders with both cameras' images of the board")
            return False
        return True

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        chosen = settings(context)
        board = f"chessboard:{chosen.board_columns}x{chosen.board_rows}:{chosen.board_square_mm:g}mm"
        self._target = str(user_folder("calibrations") / "cameras.toml")
        arguments = ["calibrate", "cameras", "--board", board, "--out", self._target]
        for side in ("left", "right"):
            folder = absolute(getattr(chosen, f"board_{side}"))
            if not Path(folder).is_dir():
                raise CalibrationError("is no folder", where=folder, advice=f"choose the {side} camera's images")
            arguments += [f"--{side}", folder]
        return arguments

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the new calibration."""
        settings(context).calibration = self._target
        text = f"{summary.get('verdict', 'done')}: {float(summary.get('stereo_rms_px', 0.0)):.2f} px"
        advice = summary.get("advice") or ""
        advice = "; ".join(advice) if isinstance(advice, list) else str(advice)
        return f"{text}; {advice}" if advice else text


class PERFANIM_OT_open_calibration(bpy.types.Operator, ImportHelper):
    """Open the calibration of two cameras from a file, also one that another program wrote in this form"""

    bl_idname = "perfanim.open_calibration"
    bl_label = "Open Calibration"
    filename_ext = ".toml"
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs."""
        return common.in_scene(cls, context) and common.idle(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Check the file and use it."""
        found = states.rig(self.filepath)
        if not isinstance(found, PerfanimError) and len(found.cameras) < 2:
            found = CalibrationError("has fewer than two cameras", where=self.filepath)
        if isinstance(found, PerfanimError):
            return common.failed(self, PANEL, found)
        settings(context).calibration = self.filepath
        running.set_message(PANEL, "")
        return {"FINISHED"}


_CLASSES = (PERFANIM_OT_calibrate_cameras, PERFANIM_OT_open_calibration)


def register() -> None:
    """Register the operators."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
