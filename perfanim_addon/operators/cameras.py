"""Calibration of the cameras."""

from pathlib import Path
from typing import Any

import bpy

from ...core.errors import CalibrationError
from ..place import absolute, user_folder
from ..properties import settings
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


_CLASSES = (PERFANIM_OT_calibrate_cameras,)


def register() -> None:
    """Register the operators."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
