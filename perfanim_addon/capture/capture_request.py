"""Build the worker's request from the scene settings."""

import secrets
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import CaptureError
from ...core.geometry.camera import CameraRig
from ...core.geometry.rig_file import rig_tables
from ...core.markers.prop import Prop, check_distinct, prop_tables
from ...core.markers.subject import Subject, subject_tables
from ...core.system.files import remove_left_behind
from ...core.worker.client import WorkerClient
from .. import take_library
from ..preferences import preferences
from ..preferences.paths import absolute
from ..settings import readiness, target_settings, vmc_input, vmc_output
from ..settings.target_settings import SIMULATED_HEIGHT_M
from .capture_run import CaptureRun

_TEMPORARY = "perfanim-"
_DAY_S = 86_400.0
# Settings of the simulated studio for faults that a capture shows.
_FAULTY: dict[str, dict[str, Any]] = {
    "DARK": {"marker_brightness": 22.0, "light": 0.05, "noise_sigma": 4.0},
    "BLURRED": {"lens_blur_px": 3.0, "noise_sigma": 3.0},
}
_PARTNERS = ("boxing", "kendo")  # who do it on the spot


@dataclass(frozen=True)
class Setup:
    """A capture that can be started.

    Args:
        performers, props: in the order of the poses.
    """

    request: dict[str, Any]
    performers: tuple[Subject, ...]
    props: tuple[Prop, ...] = ()

    def start(self, python: str | None) -> CaptureRun:
        """Start the worker; `python` is its interpreter, None for Blender's own."""
        return CaptureRun(WorkerClient(self.request, python), temporary=self.request["cameras"]["background_file"])


def make(settings: Any) -> Setup:
    """Return the capture that the settings describe.

    Raises:
        PerfanimError: a file is missing or bad.
    """
    marker_set = readiness.good(readiness.marker_set(settings))
    database_path = str(readiness.database_path(settings))
    readiness.good(readiness.database_frames(database_path))
    if settings.subject:
        subject: Subject = readiness.good(readiness.worn_subject(settings))
    else:  # the simulated performer's true body and markers
        subject = Subject("Simulated performer", default_skeleton(SIMULATED_HEIGHT_M), marker_set)
    performers = (subject, *target_settings.performers(settings.id_data))
    props = tuple(target_settings.props(settings.id_data))
    check_distinct(props)
    request = {
        "job": "capture",
        "cameras": {
            **cameras(settings),
            "source": _with_targets(source(settings), settings, len(performers) - 1) | _practised(settings),
            "preview": bool(settings.capture_preview),
            "background_file": _background_file(),
        },
        "performers": [subject_tables(performer) for performer in performers],
        "props": [prop_tables(prop) for prop in props],
        "database": database_path,
        "settings": {"method": preferences.method(bpy.context)},
        "shape": shape(settings),
        "vmc": vmc_output.target(settings.id_data),
        "take": str(take_library.new_path()),
        "character": settings.armature.name if settings.armature else "",
    }
    return Setup(request, performers, props)


def _background_file() -> str:
    folder = Path(tempfile.gettempdir())
    remove_left_behind(folder, _TEMPORARY, ".npz", _DAY_S)  # of a Blender that was killed
    return str(folder / f"{_TEMPORARY}{secrets.token_hex(4)}.npz")


def _practised(settings: Any) -> dict[str, Any]:
    """Return the simulated studio with the fault to practise on, if any."""
    is_practice = settings.source == "SIMULATED" and settings.practise
    return {"studio": _FAULTY[settings.practise_fault]} if is_practice and settings.practise_fault in _FAULTY else {}


def _with_targets(source: dict[str, Any], settings: Any, partners: int) -> dict[str, Any]:
    """Return the source with the scene's additional targets, if it simulates them.

    The simulated performer carries the first prop, and each further performer is shown by another simulated one.
    """
    if settings.source != "SIMULATED":
        return source
    carried = [target_settings.path_of(entry) for entry in target_settings.of_kind(settings.id_data, "PROP")]
    prop = {"prop": carried[0]} if carried else {}
    others = [behaviour for behaviour in _PARTNERS if behaviour != settings.behaviour]
    shown = [{"behaviour": others[index % len(others)]} for index in range(partners)]
    return {**source, **prop, **({"partners": shown} if shown else {})}


def shape(settings: Any) -> dict[str, Any]:
    """Return the settings of the pose filter, as `FilterSettings` reads them."""
    return {"smoothing_s": settings.smoothing_ms / 1000.0, "feet": settings.feet}


def cameras(settings: Any) -> dict[str, Any]:
    """Return the request of the worker's job `cameras` or `trackers`.

    Raises:
        PerfanimError: a file is missing or bad.
    """
    has_rig = readiness.has_cameras(settings) and not readiness.is_known(settings)
    return {
        "source": source(settings),
        "rig": calibration(settings, True) if has_rig else None,
        "background_s": float(settings.background_s),
        "threshold": None if settings.threshold_auto else float(settings.threshold),
    }


def calibration(settings: Any, in_use: bool = False) -> dict[str, Any]:
    """Return the tables of the chosen calibration; `in_use`: of the cameras in use.

    Raises:
        PerfanimError: the file is missing or bad.
    """
    rig: CameraRig = readiness.good(readiness.rig(absolute(settings.calibration)))
    if in_use and len(rig) > 1 and readiness.is_one_camera(settings):
        rig = CameraRig(rig.cameras[:1], rig.metadata)
    return rig_tables(rig)


def source(settings: Any) -> dict[str, Any]:
    """Return the description of the source of images or trackers.

    Raises:
        CaptureError: a file or folder is not there, or device numbers are none.
    """
    if settings.source == "SIMULATED":
        return {
            "kind": "simulated",
            "behaviour": settings.behaviour,
            "height_m": SIMULATED_HEIGHT_M,
            "loop": True,
            "marker_set": readiness.marker_set_source(settings),
        }
    if settings.source == "CAMERAS":
        return {
            "kind": "cameras",
            "devices": list(readiness.devices(settings))[: 1 if readiness.is_one_camera(settings) else None],
            "size": [settings.width, settings.height],
            "fps": settings.camera_fps or None,
            "controls": preferences.camera_controls(bpy.context),
        }
    if not readiness.has_cameras(settings):
        return vmc_input.source(settings.id_data)
    paths = [absolute(getattr(settings, name)) for name in readiness.source_paths(settings)]
    for path in paths:
        if not readiness.is_found(path):
            raise CaptureError("not found", where=path, advice="choose another under Cameras")
    kind = "videos" if settings.source == "VIDEOS" else "images"
    return {"kind": kind, "paths": paths, "fps": settings.files_fps}
