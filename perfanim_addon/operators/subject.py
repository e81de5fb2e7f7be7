"""Calibration of the performer, and the profiles of those who are calibrated."""

from pathlib import Path
from typing import Any

import bpy

from ...core.body.calibration_poses import CALIBRATION
from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import SubjectError
from ...core.markers.subject import Subject, save_subject
from ..capture import request as capture_setup
from ..capture import sound
from ..jobs import activity
from ..preferences.paths import absolute, user_folder
from ..settings import readiness
from ..settings.capture_settings import settings
from . import common
from .jobs import JobOperator

PANEL = "subject"
HELD_S = 2.0  # each pose
_TICK_HZ, _HOLD_HZ, _DONE_HZ = 660.0, 1320.0, 880.0
_TICKS = ("3:", "2:", "1:")  # the seconds before a pose that are heard


class PERFANIM_OT_calibrate_subject(JobOperator, bpy.types.Operator):
    """Find bone lengths and marker places from a marker take in which the performer holds calibration poses"""

    bl_idname = "perfanim.calibrate_subject"
    bl_label = "Calibrate from Take"
    title = "Calibrating the performer"
    panel = PANEL

    @classmethod
    def lacks(cls, context: bpy.types.Context) -> str:
        """Needs a take."""
        return "" if settings(context).subject_take else "Choose a marker take that shows a T pose"

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        chosen = settings(context)
        take = absolute(chosen.subject_take)
        if not Path(take).is_file():
            raise SubjectError("not found", where=take, advice="choose a marker take")
        marker_set, target = readiness.marker_set_source(chosen), str(profile(chosen))
        command = ["calibrate", "subject", take, "--marker-set", marker_set, "--out", target]
        command += ["--name", chosen.subject_name]
        return [*command, "--poses", ",".join(CALIBRATION)] if chosen.take_poses else command

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the new subject."""
        settings(context).subject = summary["out"]
        return _score(summary)


class _Recording(JobOperator):
    """Base of what records the performer."""

    panel = PANEL

    @classmethod
    def lacks(cls, context: bpy.types.Context) -> str:
        """Needs calibrated cameras and a marker set."""
        chosen = settings(context)
        if not readiness.has_cameras(chosen):
            return "Needs cameras: record a capture with an average body, and calibrate from its take"
        return readiness.cameras(chosen).problem or readiness.markers(chosen).problem

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Poll the worker at each tick, and let the performer hear where it is."""
        before = self._job.text
        result = super().modal(context, event)
        hertz = cue(before, self._job.text)
        if hertz:
            sound.beep(hertz)
        return result


class PERFANIM_OT_calibrate_performer(_Recording, bpy.types.Operator):
    """Learn the empty room, count down to the T pose, to hanging arms and to the motorcycle pose, record each, and find
    bone lengths and marker places from all three"""

    bl_idname = "perfanim.calibrate_performer"
    bl_label = "Calibrate Performer"
    title = "Calibrating the performer"

    def request(self, context: bpy.types.Context) -> dict[str, Any]:
        """Return what the worker is asked for."""
        chosen = settings(context)
        target = profile(chosen)
        recording = _recording(context, "calibrate performer", CALIBRATION, f"{target.stem}.take.npz")
        return {**recording, "name": chosen.subject_name, "subject_out": str(target)}

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the performer and the cameras."""
        _take_over(context, summary, True)
        settings(context).subject = summary["subject"]
        return _score(summary)


class PERFANIM_OT_record_t_pose(_Recording, bpy.types.Operator):
    """Learn the empty room, count down, and record the performer who stands in the T pose; then calibrate from it"""

    bl_idname = "perfanim.record_t_pose"
    bl_label = "Record T Pose"
    title = "Recording the T pose"

    def request(self, context: bpy.types.Context) -> dict[str, Any]:
        """Return what the worker is asked for."""
        return _recording(context, "record pose", CALIBRATION[:1], "t-pose.take.npz")

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the take and the cameras."""
        _take_over(context, summary, False)
        text = f"{summary['frames']} frames of the T pose: calibrate now"
        return f"{text}; {summary['floor_advice']}" if "floor_advice" in summary else text


class PERFANIM_OT_average_performer(bpy.types.Operator):
    """Use an average body of the performer's height with the markers at their usual places: what one camera has to do
    with, as it measures nobody"""

    bl_idname = "perfanim.average_performer"
    bl_label = "Average Body of This Height"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs a marker set."""
        if not common.in_scene(cls, context) or not common.idle(cls):
            return False
        problem = readiness.markers(settings(context)).problem
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the profile and use it."""
        chosen = settings(context)
        target = profile(chosen)
        body = default_skeleton(chosen.subject_height)
        save_subject(Subject(chosen.subject_name, body, readiness.marker_set(chosen)), target)
        chosen.subject = str(target)
        activity.set_message(PANEL, "average body, markers at their usual places")
        return {"FINISHED"}


_profiles: list[tuple[str, str, str]] = []  # Blender keeps no reference to a dynamic enumeration's strings


def _profile_items(_self: object, _context: object) -> list[tuple[str, str, str]]:
    files = sorted(user_folder("subjects").glob("[!.]*.toml"))
    _profiles[:] = [(str(file), readiness.performer_text(str(file)), str(file)) for file in files]
    return _profiles


class PERFANIM_OT_use_profile(bpy.types.Operator):
    """Use a performer who has been calibrated before"""

    bl_idname = "perfanim.use_profile"
    bl_label = "Calibrated Performers"
    bl_options = {"REGISTER", "UNDO"}

    profile: bpy.props.EnumProperty(name="Performer", description="Whom to use", items=_profile_items)
    target: bpy.props.IntProperty(
        name="Target",
        description="Which of the further targets this is, from 0; -1: the first performer",
        default=-1,
        options={"HIDDEN", "SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs one."""
        if not common.in_scene(cls, context):
            return False
        if not _profile_items(None, context):
            cls.poll_message_set("Nobody is calibrated yet")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Choose it."""
        targets = context.scene.perfanim_targets.entries
        if self.target >= 0:
            targets[min(self.target, len(targets) - 1)].subject = self.profile
        else:
            settings(context).subject = self.profile
            activity.set_message(PANEL, "")
        return {"FINISHED"}


def profile(chosen: Any) -> Path:
    """Return the file of the performer who is named."""
    name = "".join(c if c.isalnum() or c in "-_" else "-" for c in chosen.subject_name) or "performer"
    return user_folder("subjects") / f"{name}.toml"


def cue(before: str, now: str) -> float | None:
    """Return the pitch of the beep that goes with a change of what the recording says, None for none."""
    if now == before:
        return None
    if now.startswith("hold"):
        return None if before.startswith("hold") else _HOLD_HZ
    if before.startswith("hold"):
        return _DONE_HZ
    return _TICK_HZ if now.startswith(_TICKS) else None


def _recording(context: bpy.types.Context, job: str, poses: tuple[str, ...], take: str) -> dict[str, Any]:
    """Return the request for a recording of poses."""
    chosen = settings(context)
    return {
        **capture_setup.cameras(chosen),
        "job": job,
        "marker_set": readiness.marker_set_source(chosen),
        "poses": poses,
        "countdown_s": chosen.countdown_s,
        "between_s": chosen.between_s,
        "seconds": HELD_S,
        "out": str(user_folder("subjects") / take),
        "floor_out": str(user_folder("calibrations") / "cameras-on-floor.toml"),
    }


def _take_over(context: bpy.types.Context, summary: dict[str, Any], all_poses: bool) -> None:
    """Use the take, and the cameras with the floor that its feet showed."""
    chosen = settings(context)
    chosen.subject_take, chosen.take_poses = summary["out"], all_poses
    if "calibration" in summary:
        chosen.calibration = summary["calibration"]


def _score(summary: dict[str, Any]) -> str:
    """Return how good a calibration is and what would make it better."""
    told = [f"{summary['verdict']}: residual {float(summary['residual_mm']):.0f} mm", *summary["advice"]]
    return "; ".join(told + ([summary["floor_advice"]] if "floor_advice" in summary else []))


_CLASSES = (
    PERFANIM_OT_calibrate_performer,
    PERFANIM_OT_record_t_pose,
    PERFANIM_OT_calibrate_subject,
    PERFANIM_OT_average_performer,
    PERFANIM_OT_use_profile,
)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
