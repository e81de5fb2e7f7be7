"""Operators for the guide: show the cameras, check the setup, skip a step."""

from typing import Any

import bpy

from ...core.geometry.arrays import Image
from ...core.subjects.setup_check.finding import Fault
from ...core.worker.requests import CheckSetupRequest, ShowCamerasRequest
from ..capture import capture_request
from ..preferences import preferences
from ..preferences.paths import absolute, user_folder
from ..preferences.property_kinds import HIDDEN, whole_number
from ..settings import camera_choice, guide_steps, ignored_places, readiness
from ..settings.capture_settings import settings
from ..viewport import overlay, picture_overlay
from .job_operators import JobOperator
from .operator_bases import PanelOperator, need

PANEL = "guide"


class _PictureJob(JobOperator):
    """Base of jobs with a final picture that stays in the viewport until the next job."""

    panel = PANEL

    def keep_picture(self, line: str) -> Image | None:
        """Show the job's last picture with a line above it; return the picture."""
        picture: Image | None = self._job.take_preview()
        if picture is not None:
            picture_overlay.show(picture, line)
        return picture


class PERFANIM_OT_show_cameras(_PictureJob, bpy.types.Operator):
    """Show one picture of each camera, so that you can choose Left and Right"""

    bl_label = "Show Cameras"
    title = "Looking for cameras"

    def request(self, context: bpy.types.Context) -> ShowCamerasRequest:
        return ShowCamerasRequest()

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        picture = self.keep_picture("Choose Left and Right")
        if picture is not None:
            camera_choice.keep_pictures([int(camera["device"]) for camera in summary["cameras"]], picture)
        found = ", ".join(str(camera["device"]) for camera in summary["cameras"])
        return f"cameras {found}" if len(summary["cameras"]) > 1 else f"only camera {found}"


class PERFANIM_OT_check_setup(_PictureJob, bpy.types.Operator):
    """Check light, cameras and markers for faults: leave the view empty,
    then stand in front of the cameras, hold a T pose and walk about. Without markers: walk about"""

    bl_label = "Check Setup"
    title = "Checking the setup"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        chosen = settings(context)
        if readiness.is_known(chosen) or not readiness.has_cameras(chosen):
            return "Needs cameras as the source, or Practise Calibration"
        found = readiness.pictures(chosen).problem or readiness.markers(chosen).problem
        return found or (readiness.cameras(chosen).problem if readiness.follows_person(chosen) else "")

    def request(self, context: bpy.types.Context) -> CheckSetupRequest:
        chosen = settings(context)
        is_practice = chosen.source == "SIMULATED" and chosen.practise_fault != "NONE"
        return CheckSetupRequest(
            source=capture_request.source(chosen),
            rig=capture_request.calibration(chosen, True) if readiness.cameras(chosen).ready else None,
            background_s=chosen.background_s,
            countdown_s=chosen.countdown_s,
            marker_set=readiness.marker_set_source(chosen),
            people=capture_request.people(chosen),
            fault=str(Fault[chosen.practise_fault]) if is_practice else "",
            ignored=tuple(ignored_places.ignored(chosen)),
            floor_out=str(user_folder("calibrations") / "cameras-on-floor.toml"),
        )

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        chosen = settings(context)
        chosen.calibration = summary.get("calibration", chosen.calibration)
        guide_steps.keep_check(chosen, summary)
        if summary["findings"]:
            named = ", ".join(dict.fromkeys(str(row["fault"]) for row in summary["findings"]))
            self.keep_picture(named)
            return f"fix first: {named}"
        space = guide_steps.space(chosen)
        if space:
            self.keep_picture(space)
            overlay.show_space(readiness.rig(absolute(chosen.calibration)))
        return "; ".join(filter(None, ("no fault was found", space, summary.get("floor_advice"))))


class PERFANIM_OT_propose_exposure(PanelOperator, bpy.types.Operator):
    """Set the exposure that keeps fast markers sharp on both cameras; reflective markers stay bright enough"""

    bl_label = f"Set {preferences.PROPOSED_MS} ms"
    panel = PANEL

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        is_set = all(
            not camera.exposure_auto and camera.exposure_ms <= preferences.PROPOSED_MS
            for camera in preferences.cameras_of(context)
        )
        return "Both cameras have such an exposure" if is_set else ""

    def run(self, context: bpy.types.Context) -> None:
        for camera in preferences.cameras_of(context):
            camera.exposure_auto, camera.exposure_ms = False, preferences.PROPOSED_MS
        guide_steps.seen.forget_pictures()


class PERFANIM_OT_ignore_reflections(PanelOperator, bpy.types.Operator):
    """From now on, ignore bright spots at the ringed places, or at one of them,
    live and in videos tracked with this calibration. A marker that passes through such a place is not seen there, so it
    is better to cover whatever reflects"""

    bl_label = "Ignore These Places"
    panel = PANEL
    number: whole_number("Number", "Number of the ring; 0 for all rings", 0, 0, options=HIDDEN)
    missing_input = need(
        lambda context: guide_steps.reflections(settings(context)), "Check Setup has found no reflection"
    )

    def run(self, context: bpy.types.Context) -> None:
        chosen = settings(context)
        found = guide_steps.reflections(chosen)
        places = {number: place for number, place in found.items() if self.number in (0, number)}
        ignored_places.keep(chosen, [*ignored_places.ignored(chosen), *places.values()])
        if guide_steps.forgive_reflections(places):
            picture_overlay.hide()


class PERFANIM_OT_forget_ignored(PanelOperator, bpy.types.Operator):
    """Look for markers at these places again"""

    bl_label = "Stop Ignoring"
    panel = PANEL
    camera: whole_number("Camera", "Number of the camera, from 0", 0, 0, options={"HIDDEN"})
    missing_input = need(lambda context: ignored_places.ignored(settings(context)), "No place is ignored")

    def run(self, context: bpy.types.Context) -> None:
        chosen = settings(context)
        ignored_places.keep(chosen, [place for place in ignored_places.ignored(chosen) if place[0] != self.camera])
        guide_steps.seen.forget_pictures()


class PERFANIM_OT_skip_step(PanelOperator, bpy.types.Operator):
    """Continue without this step; a capture can start, but may be worse"""

    bl_label = "Skip This Step"
    panel = PANEL

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        chosen = settings(context)
        passing = guide_steps.next_step(chosen)[1].passing(chosen)
        return "" if passing else "A capture cannot start without this step"

    def run(self, context: bpy.types.Context) -> None:
        guide_steps.skip(settings(context))
        picture_overlay.hide()  # it shows a fault of this step


class PERFANIM_OT_unskip_steps(PanelOperator, bpy.types.Operator):
    """Go back to the first step that was skipped"""

    bl_label = "Go Back to Skipped Steps"
    panel = PANEL
    missing_input = need(lambda _context: guide_steps.seen.skipped, "No step was skipped")

    def run(self, context: bpy.types.Context) -> None:
        guide_steps.seen.skipped.clear()
