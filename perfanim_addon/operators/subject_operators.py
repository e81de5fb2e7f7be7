"""Operators for the performer: calibrate, use a profile."""

from pathlib import Path
from typing import Any

import bpy

from ...core.body.calibration_poses import CALIBRATION
from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import SubjectError, counted
from ...core.markers.subject import Subject, save_subject
from ...core.system.files import is_file
from ...core.worker.job_status import PoseCue, PoseStage
from ...core.worker.requests import CalibratePerformerRequest, RecordPoseRequest
from ..capture import capture_request, sound
from ..capture.tuning import TUNING
from ..preferences.paths import absolute, user_folder
from ..preferences.property_kinds import HIDDEN, dynamic_choice, whole_number
from ..settings import readiness
from ..settings.capture_settings import settings
from .job_operators import JobOperator
from .operator_bases import UndoOperator, need

PANEL = "subject"


class PERFANIM_OT_calibrate_subject(JobOperator, bpy.types.Operator):
    """Measure bone lengths and marker positions from a take of the calibration poses.
    For a take of other motion, use Refine Performer under Takes"""

    bl_label = "Calibrate from Take"
    title = "Calibrating the performer"
    panel = PANEL
    missing_input = need(lambda context: settings(context).subject_take, "Choose a marker take with a T pose")

    def arguments(self, context: bpy.types.Context) -> list[str]:
        chosen = settings(context)
        take = absolute(chosen.subject_take)
        if not is_file(take):
            raise SubjectError("not found", where=take, advice="choose a marker take")
        marker_set, target = readiness.marker_set_source(chosen), str(profile_path(chosen.subject_name))
        command = ["calibrate", "subject", take, "--marker-set", marker_set, "--out", target]
        command += ["--name", chosen.subject_name]
        return [*command, "--poses", ",".join(CALIBRATION)] if chosen.take_poses else command

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        settings(context).subject = summary["out"]
        return _score(summary)


class _Recording(JobOperator):
    """Base of the operators that record the performer."""

    panel = PANEL

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        chosen = settings(context)
        if not readiness.has_cameras(chosen):
            return "Needs cameras: capture with an average body, then use Calibrate from Take"
        return readiness.cameras(chosen).problem or readiness.markers(chosen).problem

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        before = self._job.cue
        result = super().modal(context, event)
        hertz = pitch(before, self._job.cue)
        if hertz:
            sound.beep(hertz)
        return result


class PERFANIM_OT_calibrate_performer(_Recording, bpy.types.Operator):
    """Record T pose, hanging arms and motorcycle pose to measure the performer.
    Each has a countdown. Leave the view empty at the start"""

    bl_label = "Calibrate Performer"
    title = "Calibrating the performer"

    def request(self, context: bpy.types.Context) -> CalibratePerformerRequest:
        chosen = settings(context)
        target = profile_path(chosen.subject_name)
        recording = _recording_fields(context, CALIBRATION, f"{target.stem}.take.npz")
        return CalibratePerformerRequest(**recording, name=chosen.subject_name, subject_out=str(target))

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        _take_over(context, summary, True)
        settings(context).subject = summary["subject"]
        return _score(summary)


class PERFANIM_OT_record_t_pose(_Recording, bpy.types.Operator):
    """Record the T pose after a countdown. Leave the view empty at the start"""

    bl_label = "Record T Pose"
    title = "Recording the T pose"

    def request(self, context: bpy.types.Context) -> RecordPoseRequest:
        return RecordPoseRequest(**_recording_fields(context, CALIBRATION[:1], "t-pose.take.npz"))

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        _take_over(context, summary, False)
        text = f"{counted(summary['frames'], 'frame')} of the T pose: calibrate now"
        return f"{text}; {summary['floor_advice']}" if "floor_advice" in summary else text


class PERFANIM_OT_average_performer(UndoOperator, bpy.types.Operator):
    """Use an average body of this height with default marker positions.
    One camera cannot measure the performer and needs this body"""

    bl_label = "Average Body of This Height"
    panel = PANEL
    missing_input = staticmethod(lambda context: readiness.markers(settings(context)).problem)

    def run(self, context: bpy.types.Context) -> str:
        chosen = settings(context)
        target = profile_path(chosen.subject_name)
        body = default_skeleton(chosen.subject_height)
        save_subject(Subject(chosen.subject_name, body, readiness.marker_set(chosen)), target)
        chosen.subject = str(target)
        return "average body, default marker positions"


def _profiles(_context: object) -> list[tuple[str, str, str]]:
    """Return an item for each file; a performer may have several, such as the calibrated and the refined one."""
    files = sorted(user_folder("subjects").glob("[!.]*.toml"))
    return [(str(file), f"{file.stem}: {readiness.performer_text(str(file))}", str(file)) for file in files]


class PERFANIM_OT_use_profile(UndoOperator, bpy.types.Operator):
    """Use a calibrated performer"""

    bl_label = "Calibrated Performers"
    needs_idle = False
    panel = PANEL
    profile: dynamic_choice("Performer", "Performer to use", _profiles)
    target: whole_number("Target", "Index of the additional target; -1 for the first performer", -1, -1, options=HIDDEN)
    missing_input = need(_profiles, "No performer is calibrated yet")

    def run(self, context: bpy.types.Context) -> None:
        targets = context.scene.perfanim_targets.entries
        if self.target >= len(targets):
            raise SubjectError("the chosen target was removed", advice="choose another in the list")
        owner = targets[self.target] if self.target >= 0 else settings(context)
        owner.subject = self.profile


def profile_path(name: str) -> Path:
    """Return the file for a performer's name."""
    plain = "".join(c if c.isalnum() or c in "-_" else "-" for c in name) or "performer"
    return user_folder("subjects") / f"{plain}.toml"


def pitch(before: PoseCue | None, now: PoseCue | None) -> float | None:
    """Return the pitch of the beep for a change of the cue, Hz; None for no beep."""
    was_held, is_held = (cue is not None and cue.stage is PoseStage.HOLD for cue in (before, now))
    if is_held != was_held:
        return TUNING.hold_hz if is_held else TUNING.done_hz
    is_counted = now is not None and not is_held and now != before and now.left_s in TUNING.heard_s
    return TUNING.tick_hz if is_counted else None


def _recording_fields(context: bpy.types.Context, poses: tuple[str, ...], take: str) -> dict[str, Any]:
    """Return the fields of a request that records poses."""
    chosen = settings(context)
    rig = None if readiness.is_known(chosen) else capture_request.calibration(chosen, True)
    return {
        **capture_request.camera_fields(chosen, rig),
        "marker_set": readiness.marker_set_source(chosen),
        "poses": poses,
        "countdown_s": chosen.countdown_s,
        "between_s": chosen.between_s,
        "seconds": TUNING.held_s,
        "out": str(user_folder("subjects") / take),
        "floor_out": str(user_folder("calibrations") / "cameras-on-floor.toml"),
    }


def _take_over(context: bpy.types.Context, summary: dict[str, Any], all_poses: bool) -> None:
    """Use the take, and the calibration with the floor found from the feet."""
    chosen = settings(context)
    chosen.subject_take, chosen.take_poses = summary["out"], all_poses
    if "calibration" in summary:
        chosen.calibration = summary["calibration"]


def _score(summary: dict[str, Any]) -> str:
    text = [f"{summary['verdict']}: residual {float(summary['residual_mm']):.0f} mm", *summary["advice"]]
    return "; ".join(text + ([summary["floor_advice"]] if "floor_advice" in summary else []))
