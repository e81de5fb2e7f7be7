"""From the settings of the panels to a running capture: the worker's request and the session that solves its frames."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.camera import CameraRig
from ..core.errors import CaptureError, PerfanimError
from ..core.marker_set import MarkerSet, Subject
from ..core.product_skeleton import default_skeleton
from ..core.simulate.studio.rig import default_rig
from ..core.worker.client import WorkerClient
from . import states
from .capture_state import CaptureRun
from .place import absolute

if TYPE_CHECKING:
    from ..core.session import Session

SIMULATED_HEIGHT_M = 1.75


@dataclass(frozen=True)
class Setup:
    """A capture that can be started.

    Args:
        request: what the worker is asked for.
        subject: who performs.
        session: solves the frames.
    """

    request: dict[str, Any]
    subject: Subject
    session: "Session"

    def start(self, python: str | None) -> CaptureRun:
        """Start the worker; `python` is its interpreter, None for Blender's own."""
        return CaptureRun(WorkerClient(self.request, python), self.session)


def make(settings: Any) -> Setup:
    """Return what the settings ask for.

    Raises:
        PerfanimError: a file is missing or bad.
    """
    from ..core.session import Session  # with what it needs of scipy too much for every start of Blender

    marker_set = _good(states.marker_set(settings))
    rig = _rig(settings)
    subject = _subject(settings, marker_set)
    database = _good(states.database(str(states.database_path(settings))))
    request = {
        "job": "capture",
        "source": source(settings),
        "rig": absolute(settings.calibration) if settings.source != "SIMULATED" else None,
        "background_s": float(settings.background_s),
        "threshold": None if settings.threshold_auto else float(settings.threshold),
        "markers": len(subject.marker_set),
    }
    return Setup(request, subject, Session(subject, database, rig))


def _good(found: Any) -> Any:
    if isinstance(found, PerfanimError):
        raise found
    return found


def _rig(settings: Any) -> CameraRig:
    if settings.source == "SIMULATED":
        return default_rig()
    rig: CameraRig = _good(states.rig(absolute(settings.calibration)))
    return rig


def _subject(settings: Any, marker_set: MarkerSet) -> Subject:
    if settings.subject:
        subject: Subject = _good(states.subject(absolute(settings.subject)))
        return subject
    return Subject("Simulated performer", default_skeleton(SIMULATED_HEIGHT_M), marker_set)


def source(settings: Any) -> dict[str, Any]:
    """Return the description of the image source, as `core.sources` takes it.

    Raises:
        CaptureError: a file or folder is not there.
    """
    if settings.source == "SIMULATED":
        return {
            "kind": "simulated",
            "behaviour": settings.behaviour,
            "height_m": SIMULATED_HEIGHT_M,
            "live": True,
            "marker_set": absolute(settings.marker_set_file) or settings.marker_set,
        }
    if settings.source == "CAMERAS":
        return {
            "kind": "cameras",
            "devices": [settings.left_device, settings.right_device],
            "size": [settings.width, settings.height],
            "fps": settings.camera_fps,
        }
    names = ("left_video", "right_video") if settings.source == "VIDEOS" else ("left_folder", "right_folder")
    paths = [absolute(getattr(settings, name)) for name in names]
    for path in paths:
        if not Path(path).exists():
            raise CaptureError("not found", where=path, advice="choose another under Cameras")
    kind = "videos" if settings.source == "VIDEOS" else "images"
    return {"kind": kind, "paths": paths, "fps": settings.files_fps}
