"""Calibration of the cameras."""

from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ExportHelper

from ...core.errors import CalibrationError
from .. import capture_setup
from ..place import absolute, user_folder
from ..properties import PERFANIM_PG_settings, settings
from .jobs import JobOperator

PANEL = "cameras"
SIMULATED_BOARD = (9, 6, 80.0)  # inner corners and square in mm of the board that the simulated performer holds


def board_spec(chosen: PERFANIM_PG_settings) -> str:
    """Return the board as the calibration takes it."""
    return f"chessboard:{chosen.board_columns}x{chosen.board_rows}:{chosen.board_square_mm:g}mm"


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
        self._target = str(user_folder("calibrations") / "cameras.toml")
        arguments = ["calibrate", "cameras", "--board", board_spec(chosen), "--out", self._target]
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


class PERFANIM_OT_record_board(JobOperator, bpy.types.Operator):
    """Take pictures of the chessboard with both cameras at once, with time to move it between two; then calibrate"""

    bl_idname = "perfanim.record_board"
    bl_label = "Record Pictures"
    title = "Recording the board"
    panel = PANEL

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs cameras."""
        if not super().poll(context):
            return False
        if settings(context).source not in ("CAMERAS", "SIMULATED"):
            cls.poll_message_set("Pictures are recorded with cameras: choose folders, or cameras as the source")
            return False
        return True

    def request(self, context: bpy.types.Context) -> dict[str, Any]:
        """Return what the worker is asked for."""
        chosen = settings(context)
        if chosen.source == "SIMULATED":
            chosen.board_columns, chosen.board_rows, chosen.board_square_mm = SIMULATED_BOARD
        return {
            "job": "record board",
            "source": capture_setup.source(chosen),
            "board": board_spec(chosen),
            "pictures": chosen.board_pictures,
            "every_s": chosen.board_every_s,
            "out": str(user_folder("calibrations", "board")),
        }

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the pictures."""
        chosen = settings(context)
        chosen.board_left, chosen.board_right = summary["left"], summary["right"]
        return f"{summary['pictures']} pictures of {summary['tries']} show the board to both cameras: calibrate now"


class PERFANIM_OT_save_board(JobOperator, bpy.types.Operator, ExportHelper):
    """Write the chessboard as a PDF to print, at its true size"""

    bl_idname = "perfanim.save_board"
    bl_label = "Board to Print"
    title = "Writing the board"
    panel = PANEL
    filename_ext = ".pdf"
    filter_glob: bpy.props.StringProperty(default="*.pdf", options={"HIDDEN"})

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        return ["calibrate", "board", "--spec", board_spec(settings(context)), "--out", self.filepath]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Say what to print it on."""
        return f"print {Path(summary['out']).name} on {summary['paper']} at 100 %, then measure a square"


_CLASSES = (PERFANIM_OT_save_board, PERFANIM_OT_record_board, PERFANIM_OT_calibrate_cameras)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
