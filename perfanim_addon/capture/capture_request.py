"""The worker's request, built from the scene settings."""

import secrets
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import CaptureError
from ...core.geometry.camera import CameraRig
from ...core.markers.prop import Prop, check_distinct
from ...core.markers.subject import Subject
from ...core.session.pose_filters import FilterSettings
from ...core.simulate.studio.simulated_performer import Partner, SimulatedPerformer
from ...core.system.files import remove_left_behind
from ...core.vision.people.network_file import body_network_file
from ...core.vision.sources.source_requests import ImageFiles, LiveCameras, VideoFiles
from ...core.worker.client import WorkerClient
from ...core.worker.requests import CamerasRequest, CaptureRequest, SourceRequest, TrackerSource
from .. import take_library
from ..preferences import preferences
from ..preferences.paths import absolute
from ..settings import readiness, target_settings, vmc_settings
from ..settings.target_settings import SIMULATED_HEIGHT_M
from ..viewport import performer_screen
from .capture_run import CaptureRun

_TEMPORARY = "perfanim-"
_DAY_S = 86_400.0
# Settings of the simulated studio for faults that are visible in a capture.
_FAULTY: dict[str, dict[str, Any]] = {
    "DARK": {"marker_brightness": 22.0, "light": 0.05, "noise_sigma": 4.0},
    "BLURRED": {"lens_blur_px": 3.0, "noise_sigma": 3.0},
}
_PARTNERS = ("boxing", "kendo")  # simulated behaviours that stay in one place


@dataclass(frozen=True)
class Setup:
    """A capture that is ready to start."""

    request: CaptureRequest
    performers: tuple[Subject, ...]
    props: tuple[Prop, ...] = ()

    def start(self, python: str | None) -> CaptureRun:
        """Start the worker; `python` is its interpreter, None for Blender's own."""
        return CaptureRun(WorkerClient(self.request, python), temporary=self.request.cameras.background_file)


def make(settings: Any) -> Setup:
    """Return the capture that the settings describe; PerfanimError if a file is missing or damaged."""
    marker_set = readiness.marker_set(settings)
    database_path = str(readiness.database_path(settings))
    readiness.database_frames(database_path)  # raises for a damaged database
    if settings.subject or readiness.follows_person(settings):
        subject = readiness.worn_subject(settings)
    else:  # the simulated performer's true body and markers
        subject = Subject("Simulated performer", default_skeleton(SIMULATED_HEIGHT_M), marker_set)
    performers = (subject, *target_settings.performers(settings.id_data))
    props = tuple(target_settings.props(settings.id_data))
    check_distinct(props)
    wanted = cameras(settings)
    request = CaptureRequest(
        cameras=replace(
            wanted,
            source=_with_targets(wanted.source, settings, len(performers) - 1),
            preview=settings.capture_preview or performer_screen.window() is not None,
            background_file=_background_file(),
        ),
        performers=performers,
        props=props,
        database=database_path,
        settings={"method": preferences.method(bpy.context)},
        shape=shape(settings),
        vmc=vmc_settings.target(settings.id_data),
        take=str(take_library.new_path()),
        character=settings.armature.name if settings.armature else "",
    )
    return Setup(request, performers, props)


def _background_file() -> str:
    folder = Path(tempfile.gettempdir())
    remove_left_behind(folder, _TEMPORARY, ".npz", _DAY_S)  # left by a Blender that was killed
    return str(folder / f"{_TEMPORARY}{secrets.token_hex(4)}.npz")


def _with_targets(chosen: SourceRequest, settings: Any, partners: int) -> SourceRequest:
    """Return the source with the scene's additional targets and the fault to practise on, if it is simulated.

    The simulated performer carries the first prop, and each further performer is played by another simulated one.
    """
    if not isinstance(chosen, SimulatedPerformer):
        return chosen
    carried = [target_settings.path_of(entry) for entry in target_settings.of_kind(settings.id_data, "PROP")]
    others = [behaviour for behaviour in _PARTNERS if behaviour != settings.behaviour]
    shown = tuple(Partner(others[index % len(others)]) for index in range(partners))
    fault = _FAULTY.get(settings.practise_fault, {}) if settings.practise else {}
    return replace(chosen, at_once=True, prop=carried[0] if carried else "", partners=shown, studio=fault)


def shape(settings: Any) -> FilterSettings:
    """Return the settings of the pose filter."""
    return FilterSettings(settings.smoothing_ms / 1000.0, settings.feet, settings.immediate)


def cameras(settings: Any) -> CamerasRequest:
    """Return the request for the cameras or trackers; PerfanimError if a file is missing or damaged."""
    has_rig = readiness.has_cameras(settings) and not readiness.is_known(settings)
    rig = calibration(settings, True) if has_rig else None
    return CamerasRequest(**camera_fields(settings, rig), people=people(settings))


def people(settings: Any) -> str:
    """Return the file of the body network if a person without markers is followed, else ""."""
    return str(body_network_file()) if readiness.follows_person(settings) else ""


def camera_fields(settings: Any, rig: CameraRig | None) -> dict[str, Any]:
    """Return the fields that all requests with cameras have in common."""
    return {
        "source": source(settings),
        "rig": rig,
        "background_s": settings.background_s,
        "threshold": None if settings.threshold_auto else settings.threshold,
    }


def calibration(settings: Any, in_use: bool = False) -> CameraRig:
    """Return the calibration, if `in_use` only of the cameras in use; PerfanimError for a missing or bad file."""
    rig = readiness.rig(absolute(settings.calibration))
    if in_use and len(rig) > 1 and readiness.is_one_camera(settings):
        return CameraRig(rig.cameras[:1], rig.metadata)
    return rig


def source(settings: Any) -> SourceRequest:
    """Return the source of images or trackers; CaptureError for a missing file or an unusable device."""
    if settings.source == "SIMULATED":
        return SimulatedPerformer(
            behaviour=settings.behaviour,
            height_m=SIMULATED_HEIGHT_M,
            loop=True,
            marker_set=readiness.marker_set_source(settings),
        )
    if settings.source == "CAMERAS":
        return LiveCameras(
            devices=tuple(readiness.devices(settings))[: 1 if readiness.is_one_camera(settings) else None],
            size=(settings.width, settings.height),
            fps=settings.camera_fps or None,
            controls=preferences.camera_controls(bpy.context),
        )
    if not readiness.has_cameras(settings):
        trackers = settings.id_data.perfanim_receiving
        return TrackerSource(trackers.port, sender=trackers.sender.strip())
    paths = tuple(absolute(getattr(settings, name)) for name in readiness.source_paths(settings))
    for path in paths:
        if not readiness.is_found(path):
            raise CaptureError("not found", where=path, advice="choose another under Cameras")
    files = VideoFiles if settings.source == "VIDEOS" else ImageFiles
    return files(paths, fps=settings.files_fps)
