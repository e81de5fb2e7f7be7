"""Operators for the cameras: calibrate, set the floor, print a board."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ExportHelper

from ...core.errors import CalibrationError, counted
from ...core.geometry.camera import CameraRig
from ...core.geometry.rig_file import rig_from, save_rig
from ...core.system.files import is_folder
from ...core.vision.people.network_file import body_network_file
from ...core.vision.sources.source_requests import LiveCameras
from ...core.worker.requests import (
    FloorMarkersRequest,
    RecordBoardRequest,
    RecordFloorRequest,
    RecordWalkRequest,
    Request,
)
from ..capture import capture_request, sound
from ..capture.tuning import TUNING
from ..jobs.job import command
from ..preferences.paths import absolute, user_folder
from ..settings import ignored_places, readiness
from ..settings.capture_settings import PERFANIM_PG_settings, settings
from .job_operators import JobOperator
from .operator_bases import need

PANEL = "cameras"
_BY_WALKING = "cameras-by-walking.toml"
_RECORDED = {"VIDEOS": "video", "IMAGES": "folder"}  # endings of the settings that hold the recordings
SIMULATED_BOARD = (9, 6, 80.0)  # inner corners and square in mm


def board_spec(chosen: PERFANIM_PG_settings) -> str:
    """Return the board in the command line's notation."""
    size = f"{chosen.board_columns}x{chosen.board_rows}:{chosen.board_square_mm:g}mm"
    if chosen.board_kind == "CHARUCO":
        return f"charuco:{size}:{chosen.board_code_mm:g}mm:{chosen.board_dictionary}"
    return f"chessboard:{size}"


class PERFANIM_OT_calibrate_cameras(JobOperator, bpy.types.Operator):
    """Calibrate both cameras from images of the board that they took at the same moments"""

    bl_label = "Calibrate from Pictures"
    title = "Calibrating the cameras"
    panel = PANEL
    missing_input = need(
        lambda context: settings(context).board_left and settings(context).board_right,
        "Choose the folders with each camera's images of the board",
    )

    def arguments(self, context: bpy.types.Context) -> list[str]:
        chosen = settings(context)
        self._target = str(user_folder("calibrations") / "cameras.toml")
        arguments = ["calibrate", "cameras", "--board", board_spec(chosen), "--out", self._target]
        for side in ("left", "right"):
            folder = absolute(getattr(chosen, f"board_{side}"))
            if not is_folder(folder):
                raise CalibrationError("is not a folder", where=folder, advice=f"choose the {side} camera's images")
            arguments += [f"--{side}", folder]
        return arguments

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        settings(context).calibration = self._target
        return _quality(summary)


class PERFANIM_OT_calibrate_walking(JobOperator, bpy.types.Operator):
    """Calibrate both cameras, without a board, by a person who walks about for 20 seconds: in the recording, or in
    front of the cameras after a countdown. Lenses that were calibrated with a board are kept"""

    bl_label = "Calibrate by Walking"
    title = "Calibrating the cameras"
    panel = PANEL

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        chosen = settings(context)
        if chosen.source not in ("CAMERAS", *_RECORDED):
            return "Needs cameras, videos or image folders as the source"
        if chosen.source == "CAMERAS" and chosen.right_device == readiness.NONE:
            return "Needs two cameras; a single one is calibrated with the board"
        return readiness.network(chosen).problem

    def request(self, context: bpy.types.Context) -> Request:
        chosen = settings(context)
        if chosen.source != "CAMERAS":
            return command(self.arguments(context))
        source, lenses = _all_cameras(chosen), _lenses(chosen)
        return RecordWalkRequest(
            source=source,
            rig=lenses if lenses and len(lenses) == len(source.devices) else None,
            people=str(body_network_file()),
            countdown_s=chosen.countdown_s,
            height_m=chosen.subject_height,
        )

    def arguments(self, context: bpy.types.Context) -> list[str]:
        chosen = settings(context)
        arguments = ["calibrate", "cameras", "--by-walking", "--out", str(user_folder("calibrations") / _BY_WALKING)]
        arguments += ["--height", f"{chosen.subject_height:.3f}"]
        for side in ("left", "right"):
            arguments += [f"--{side}", absolute(getattr(chosen, f"{side}_{_RECORDED[chosen.source]}"))]
        if _lenses(chosen):
            arguments += ["--lenses", absolute(chosen.calibration)]
        return arguments

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        if "rig" in summary:
            _use_rig(settings(context), summary, _BY_WALKING)
        else:
            settings(context).calibration = str(user_folder("calibrations") / _BY_WALKING)
        return _quality(summary)


def _all_cameras(chosen: PERFANIM_PG_settings) -> LiveCameras:
    """Return all chosen cameras, even if the current calibration has only one."""
    return replace(capture_request.source(chosen), devices=tuple(readiness.devices(chosen)))


def _lenses(chosen: PERFANIM_PG_settings) -> CameraRig | None:
    """Return the present calibration if a board has measured both lenses."""
    present = absolute(chosen.calibration)
    rig = readiness.found(readiness.rig, present) if present else None
    is_measured = rig and "by" not in rig.metadata and {"left", "right"} <= {camera.name for camera in rig.cameras}
    return rig if is_measured else None


class _Watching(JobOperator):
    """Base of the operators that observe the board with the cameras."""

    panel = PANEL
    missing_input = need(
        lambda context: settings(context).source in ("CAMERAS", "SIMULATED"),
        "Needs cameras as the source; for images of the board use Calibrate from Pictures",
    )


class PERFANIM_OT_calibrate_board(_Watching, bpy.types.Operator):
    """Calibrate with the board held still for a moment in each place.
    Views are taken automatically until the calibration is good"""

    bl_label = "Calibrate with Board"
    title = "Calibrating the cameras"
    finishable = True

    def request(self, context: bpy.types.Context) -> RecordBoardRequest:
        chosen = settings(context)
        fields, every_s = _board_fields(chosen), None
        if isinstance(fields["source"], LiveCameras):
            fields["source"] = _all_cameras(chosen)
            every_s = chosen.board_every_s if chosen.board_timed else None
        out = str(user_folder("calibrations", "board"))
        return RecordBoardRequest(**fields, limit=chosen.board_views, every_s=every_s, out=out)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Poll the worker on each tick, and beep when a view was taken."""
        before = self._job.views
        result = super().modal(context, event)
        if self._job.views > before:
            sound.beep(TUNING.hold_hz)
        return result

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        chosen = settings(context)
        if len(summary["pictures"]) == 2:
            chosen.board_left, chosen.board_right = summary["pictures"]
        _use_rig(chosen, summary, "cameras.toml")
        covered = ", ".join(f"{100.0 * part:.0f} %" for part in summary["coverage"].values())
        return f"{_quality(summary)}; {counted(summary['used'], 'view')}, coverage {covered}"


class _FloorFinding(_Watching):
    """Base of the operators that find the floor with calibrated cameras."""

    title = "Finding the floor"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        return super().missing_input(context) or readiness.cameras(settings(context)).problem


class PERFANIM_OT_set_floor(_FloorFinding, bpy.types.Operator):
    """Set the floor from the board lying on it, fully visible to both cameras.
    The centre of the board becomes the origin of the capture space"""

    bl_label = "Set Floor from Board"

    def request(self, context: bpy.types.Context) -> RecordFloorRequest:
        chosen = settings(context)
        return RecordFloorRequest(**_board_fields(chosen), rig=capture_request.calibration(chosen))

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        _use_rig(settings(context), summary, "cameras-on-floor.toml")
        off = float(summary["scale"]) - 1.0
        text = "floor set at the board, origin at its centre"
        if abs(off) > 0.02:
            text += f"; the board looks {100.0 * abs(off):.0f} % too {'large' if off > 0 else 'small'}: "
            text += "check the square size, or calibrate again"
        return text


class PERFANIM_OT_set_floor_markers(_FloorFinding, bpy.types.Operator):
    """Set the floor from three or more markers; their centre becomes the origin.
    Leave the floor empty until the status text asks for them"""

    bl_label = "Set Floor from Markers"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        alone = readiness.is_one_camera(settings(context))
        return super().missing_input(context) or ("With one camera use Set Floor from Board" if alone else "")

    def request(self, context: bpy.types.Context) -> FloorMarkersRequest:
        chosen = settings(context)
        return FloorMarkersRequest(
            **capture_request.camera_fields(chosen, capture_request.calibration(chosen)),
            preview=True,
            height_m=chosen.floor_height_mm / 1000.0,
            longest_m=chosen.floor_longest_mm / 1000.0 or None,
        )

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        _use_rig(settings(context), summary, "cameras-on-floor.toml")
        text = f"floor set at the {summary['markers']} markers, origin at their centre"
        off = float(summary["scale"]) - 1.0
        wrong = "small" if off > 0 else "large"
        return f"{text}; the calibration was {100.0 * abs(off):.1f} % too {wrong}" if off else text


def _board_fields(chosen: PERFANIM_PG_settings) -> dict[str, Any]:
    """Return the source and board of a request."""
    if chosen.source == "SIMULATED":
        chosen.board_kind = "CHESSBOARD"
        chosen.board_columns, chosen.board_rows, chosen.board_square_mm = SIMULATED_BOARD
    return {"source": capture_request.source(chosen), "board": board_spec(chosen), "preview": True}


def _use_rig(chosen: PERFANIM_PG_settings, summary: dict[str, Any], name: str) -> None:
    target = user_folder("calibrations") / name
    save_rig(rig_from(summary["rig"], name).ignoring(ignored_places.ignored(chosen)), target)
    chosen.calibration = str(target)


def _quality(summary: dict[str, Any]) -> str:
    text = f"{summary.get('verdict', 'done')}: {float(summary.get('stereo_rms_px', 0.0)):.2f} px"
    return "; ".join((text, *summary.get("advice", ())))


class PERFANIM_OT_save_board(JobOperator, bpy.types.Operator, ExportHelper):
    """Save the board as a PDF for printing at its true size"""

    bl_label = "Board to Print"
    title = "Writing the board"
    panel = PANEL
    filename_ext = ".pdf"
    filter_glob: bpy.props.StringProperty(default="*.pdf", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = board_spec(settings(context)).replace(":", "-") + self.filename_ext
        return set(ExportHelper.invoke(self, context, event))

    def arguments(self, context: bpy.types.Context) -> list[str]:
        return ["calibrate", "board", "--spec", board_spec(settings(context)), "--out", self.filepath]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        return f"print {Path(summary['out']).name} on {summary['paper']} at 100 %, then measure a square"
