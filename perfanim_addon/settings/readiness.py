"""Status of each step before a capture, for its panel and for Start Capture."""

import glob
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...core.database.store import DATABASE_SUFFIX, OLD_DATABASE_SUFFIX, open_database
from ...core.errors import CaptureError, PerfanimError, SubjectError
from ...core.geometry.camera import CameraRig
from ...core.geometry.rig_file import load_rig
from ...core.markers.marker_set import MarkerSet, load_marker_set
from ...core.markers.prop import Prop, load_prop
from ...core.markers.subject import Subject, load_subject
from ...core.system.files import exists
from ..character.posing import map_problem
from ..preferences.paths import absolute, user_folder
from . import vmc_input
from .camera_choice import NETWORK, NONE, address_problem

NOT_CALIBRATED = "not calibrated"


@dataclass(frozen=True)
class StepStatus:
    """Status of a step.

    Args:
        text: a few words for the panel's header.
        problem: full explanation if not ready.
    """

    ready: bool
    text: str
    problem: str = ""


_cache: dict[tuple[str, str], tuple[tuple[int, int], Any]] = {}


def _loaded(kind: str, load: Callable[[str], Any], path: str) -> Any:
    """Return load(path) or its error, cached until the file changes."""
    try:
        facts = Path(path).stat()
        stamp = (facts.st_mtime_ns, facts.st_size)
    except OSError:
        stamp = (0, 0)
    known = _cache.get((kind, path))
    if known is None or known[0] != stamp:
        try:
            value = load(path)
        except PerfanimError as error:
            value = error
        known = _cache[(kind, path)] = (stamp, value)
    return known[1]


# The content of a file, or the error in it.
rig: Callable[[str], CameraRig | PerfanimError] = partial(_loaded, "rig", load_rig)
subject: Callable[[str], Subject | PerfanimError] = partial(_loaded, "subject", load_subject)
prop: Callable[[str], Prop | PerfanimError] = partial(_loaded, "prop", load_prop)


def good(found: Any) -> Any:
    """Return the content that was found; raise the error if it is one."""
    if isinstance(found, PerfanimError):
        raise found
    return found


def database_frames(path: str) -> int | PerfanimError:
    """Return the number of frames of a database file, or the error in it."""
    # the database itself is not kept: an open file cannot be replaced on Windows
    return _loaded("database", lambda path: open_database(path).frames, path)


def marker_set_source(settings: Any) -> str:
    """Return the name of the chosen marker set, or its file."""
    return absolute(settings.marker_set_file) or str(settings.marker_set)


def marker_set(settings: Any) -> MarkerSet | PerfanimError:
    """Return the chosen marker set, or the error in it."""
    return _loaded("marker set", load_marker_set, marker_set_source(settings))


def is_known(settings: Any) -> bool:
    """Return True if cameras and performer are simulated and need no calibration."""
    return settings.source == "SIMULATED" and not settings.practise


def has_cameras(settings: Any) -> bool:
    """Return True if the source has cameras; trackers come from another program."""
    return bool(settings.source != "VMC")


def worn_subject(settings: Any) -> Subject | PerfanimError:
    """Return the chosen subject with the chosen markers, or the conflict between them."""
    found, chosen = subject(absolute(settings.subject)), marker_set(settings)
    if isinstance(found, PerfanimError) or isinstance(chosen, PerfanimError):
        return found if isinstance(found, PerfanimError) else chosen
    try:
        return found.wearing(chosen)
    except SubjectError as error:
        return error


def starter_database_path() -> Path:
    """Return the file of the starter database; one with the old suffix stays in use."""
    folder = user_folder("databases")
    old = folder / f"starter{OLD_DATABASE_SUFFIX}"
    new = folder / f"starter{DATABASE_SUFFIX}"
    return old if old.exists() and not new.exists() else new


def database_path(settings: Any) -> Path:
    """Return the file of the database in use."""
    return Path(absolute(settings.database)) if settings.database else starter_database_path()


def _problem(error: PerfanimError, text: str) -> StepStatus:
    return StepStatus(False, text, str(error))


def pictures(settings: Any) -> StepStatus:
    """StepStatus of the source of images or trackers, without its calibration."""
    if is_known(settings):
        return StepStatus(True, "simulated")
    if not has_cameras(settings):
        wrong = vmc_input.problem(settings.id_data.perfanim_receiving)
        text = "online access is off" if wrong else f"port {settings.id_data.perfanim_receiving.port}"
        return StepStatus(not wrong, text, wrong)
    for name in source_paths(settings):
        path = absolute(getattr(settings, name))
        side = name.partition("_")[0]
        if not path:
            return StepStatus(False, f"{side} missing", f"choose the file of the {side} camera under Cameras")
        if not is_found(path):
            return StepStatus(False, f"{side} not found", f"{path}: not found; choose another under Cameras")
    if settings.source == "CAMERAS":
        try:
            devices(settings)
        except CaptureError as error:
            return _problem(error, "check cameras")
    return StepStatus(True, "chosen")


def is_found(path: str) -> bool:
    """Return whether a file or folder is there, or the folder of a pattern of names."""
    return exists(path) or (glob.has_magic(path) and exists(Path(path).parent))


def cameras(settings: Any) -> StepStatus:
    """StepStatus of the Cameras panel."""
    source = pictures(settings)
    if not source.ready or is_known(settings) or not has_cameras(settings):
        return source
    if not settings.calibration:
        return StepStatus(False, NOT_CALIBRATED, "calibrate the cameras, or open a calibration, under Cameras")
    found = rig(absolute(settings.calibration))
    if isinstance(found, PerfanimError):
        return _problem(found, "bad calibration")
    if settings.source == "CAMERAS" and not is_one_camera(settings):
        count = len(devices(settings))
        if count != len(found):
            text = f"calibrated for {len(found)} cameras, but {count} are chosen"
            return StepStatus(False, text, f"{text}: calibrate them, or open their calibration, under Cameras")
    return StepStatus(True, _rig_text(found, is_one_camera(settings)))


def devices(settings: Any) -> tuple[int | str, ...]:
    """Return the device numbers or network addresses of the chosen cameras.

    Raises:
        CaptureError: neither of both, or one camera is chosen twice.
    """
    left = _device(settings.left_device, settings.left_address, "left camera")
    if settings.right_device == NONE:
        return (left,)
    right = _device(settings.right_device, settings.right_address, "right camera")
    chosen = (left, right, *map(_further_device, settings.further_devices.replace(",", " ").split()))
    if len(set(chosen)) < len(chosen):
        raise CaptureError("one camera is chosen twice", where="cameras", advice="choose a different one for each")
    return chosen


def _device(number: int, address: str, where: str) -> int | str:
    """Return a camera's number, or its address where it has one instead."""
    if number != NETWORK:
        return number
    address = address.strip()
    if wrong := address_problem(address):
        raise CaptureError(wrong, where=where)
    return address


def _further_device(text: str) -> int | str:
    if text.isdecimal():
        return int(text)
    if ":" in text:
        return _device(NETWORK, text, "additional cameras")
    raise CaptureError(
        f"{text!r} is not a device number or an address", where="additional cameras", advice="enter e.g. 2, 3"
    )


def is_one_camera(settings: Any) -> bool:
    """Return True if only the left camera is chosen or calibrated."""
    if settings.source == "SIMULATED" or not has_cameras(settings):
        return False
    if settings.source == "CAMERAS":
        alone = settings.right_device == NONE
    else:
        alone = not getattr(settings, "right_video" if settings.source == "VIDEOS" else "right_folder")
    found = rig(absolute(settings.calibration)) if settings.calibration else None
    return alone or (isinstance(found, CameraRig) and len(found) == 1)


def source_paths(settings: Any) -> tuple[str, ...]:
    """Return the names of the settings with the files of the cameras in use."""
    both: dict[str, tuple[str, ...]] = {
        "VIDEOS": ("left_video", "right_video"),
        "IMAGES": ("left_folder", "right_folder"),
    }
    return both.get(settings.source, ())[: 1 if is_one_camera(settings) else 2]


def _rig_text(found: CameraRig, one: bool) -> str:
    if one:
        return "one camera"
    centres = [camera.centre_m for camera in found.cameras]
    apart = float(((centres[0] - centres[-1]) ** 2).sum() ** 0.5)
    rms = found.metadata.get("error")
    return f"{rms:.2f} px, {apart:.2f} m" if isinstance(rms, float) else f"{apart:.2f} m apart"


def markers(settings: Any) -> StepStatus:
    """StepStatus of the Markers panel."""
    found = marker_set(settings)
    if isinstance(found, PerfanimError):
        return _problem(found, "bad marker set")
    return StepStatus(True, f"{len(found)} markers")


def performer(settings: Any) -> StepStatus:
    """StepStatus of the Subject panel."""
    if not settings.subject:
        if is_known(settings):
            return StepStatus(True, "simulated")
        is_measured = has_cameras(settings) and not is_one_camera(settings)
        how = "calibrate the performer" if is_measured else "use an average body"
        return StepStatus(False, NOT_CALIBRATED, f"{how}, or open a subject file, under Subject")
    found = subject(absolute(settings.subject))
    if isinstance(found, PerfanimError):
        return _problem(found, "bad file")
    worn = worn_subject(settings)
    if isinstance(worn, PerfanimError) and markers(settings).ready:
        return _problem(worn, "other markers")
    return StepStatus(True, performer_text(absolute(settings.subject)))


def performer_text(path: str) -> str:
    """Return the name in a subject file and its residual, in a few words."""
    found = subject(path)
    if isinstance(found, PerfanimError):
        return f"{Path(path).stem} (bad file)"
    return f"{found.name}, {found.residual_m * 1000:.0f} mm" if found.residual_m else f"{found.name}, average body"


def motion(settings: Any) -> StepStatus:
    """StepStatus of the Motion database panel."""
    path = database_path(settings)
    if not settings.database and not exists(path):
        return StepStatus(True, "starter")
    frames = database_frames(str(path))
    if isinstance(frames, PerfanimError):
        return _problem(frames, "bad database")
    return StepStatus(True, f"{frames / 1000:.0f}k frames" if frames >= 10_000 else f"{frames} frames")


def character(settings: Any) -> StepStatus:
    """StepStatus of the Character panel."""
    armature = settings.armature
    if armature is None:
        return StepStatus(True, "new at start")
    problem = map_problem(armature)
    if problem:
        return StepStatus(False, "cannot be driven", f"{armature.name}: {problem}")
    return StepStatus(True, armature.name)


STEPS = (cameras, markers, performer, motion, character)


def first_missing_step(settings: Any) -> str:
    """Return the problem of the first step that is not ready, "" for none."""
    return next((state.problem for step in STEPS if not (state := step(settings)).ready), "")
