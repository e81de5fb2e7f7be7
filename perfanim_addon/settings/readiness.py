"""Status of each step before a capture, for its panel and for Start Capture."""

import glob
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.body.standard_skeleton import default_skeleton
from ...core.database.starter_database import STARTER
from ...core.database.store import DATABASE_SUFFIX, OLD_DATABASE_SUFFIX, open_database
from ...core.errors import CaptureError, PerfanimError, SubjectError
from ...core.geometry.camera import CameraRig
from ...core.geometry.rig_file import load_rig
from ...core.markers.marker_set import MarkerSet, load_marker_set
from ...core.markers.prop import Prop, load_prop
from ...core.markers.subject import Subject, load_subject
from ...core.system.files import exists
from ..character.retarget_plans import map_problem
from ..character.selection import active_armatures
from ..preferences import body_network
from ..preferences.paths import absolute, user_folder
from .camera_choice import NETWORK, NONE, address_problem
from .vmc_settings import receiving_problem

KEYPOINTS = "blazepose-33"  # marker set of the body network's points


class StepState(Enum):
    """State of a step."""

    READY = "ready"
    TO_DO = "to do"
    FAULTY = "faulty"


@dataclass(frozen=True)
class StepStatus:
    """Status of a step."""

    state: StepState
    text: str  # a few words for the panel's header
    problem: str = ""  # full explanation unless the step is ready
    doubt: str = ""  # why a step that is ready should be done again

    @property
    def ready(self) -> bool:
        """Whether the step is done."""
        return self.state is StepState.READY


def ready(text: str) -> StepStatus:
    """Return the status for a step that is done."""
    return StepStatus(StepState.READY, text)


def faulty(text: str, problem: object) -> StepStatus:
    """Return the status for a step with a problem or error."""
    return StepStatus(StepState.FAULTY, text, str(problem))


def _not_calibrated(problem: str) -> StepStatus:
    return StepStatus(StepState.TO_DO, "not calibrated", problem)


_cache: dict[tuple[str, str], tuple[tuple[int, int], Any]] = {}


def _loaded(kind: str, load: Callable[[str], Any], path: str) -> Any:
    """Return load(path), or raise its PerfanimError, cached until the file changes."""
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
    if isinstance(known[1], PerfanimError):
        raise known[1].with_traceback(None)  # otherwise the cached error would collect tracebacks
    return known[1]


# Return the content of a file; PerfanimError if the file is missing or damaged.
rig: Callable[[str], CameraRig] = partial(_loaded, "rig", load_rig)
subject: Callable[[str], Subject] = partial(_loaded, "subject", load_subject)
prop: Callable[[str], Prop] = partial(_loaded, "prop", load_prop)
# Number of frames; the database itself is not cached, because an open file cannot be replaced on Windows.
database_frames: Callable[[str], int] = partial(_loaded, "database", lambda path: open_database(path).frames)


def found(load: Callable[[Any], Any], source: Any) -> Any:
    """Return load(source), or None if it raises a PerfanimError."""
    try:
        return load(source)
    except PerfanimError:
        return None


def marker_set_source(settings: Any) -> str:
    """Return the name of the chosen marker set, or its file; of a person without markers, those of the network."""
    if follows_person(settings):
        return KEYPOINTS
    return absolute(settings.marker_set_file) or str(settings.marker_set)


def marker_set(settings: Any) -> MarkerSet:
    """Return the chosen marker set; PerfanimError if its file is damaged."""
    return _loaded("marker set", load_marker_set, marker_set_source(settings))


def follows_person(settings: Any) -> bool:
    """Return True if a person without markers is followed."""
    return bool(settings.follow == "PERSON" and settings.source in ("CAMERAS", "VIDEOS", "IMAGES"))


def network(_settings: Any) -> StepStatus:
    """Return the status of the body network."""
    if problem := body_network.problem():
        advice = "click Get Body Network under Cameras, or open its file"
        return StepStatus(StepState.TO_DO, "no body network", f"{problem}: {advice}")
    return ready("body network")


def is_known(settings: Any) -> bool:
    """Return True if cameras and performer are simulated and need no calibration."""
    return settings.source == "SIMULATED" and not settings.practise


def has_cameras(settings: Any) -> bool:
    """Return True unless trackers come from another program."""
    return bool(settings.source != "VMC")


def worn_subject(settings: Any) -> Subject:
    """Return the chosen subject with the chosen markers; PerfanimError if they do not fit together.

    A person without markers has a body of average proportions unless a performer is chosen, whose bones are used.
    """
    if not follows_person(settings):
        return subject(absolute(settings.subject)).wearing(marker_set(settings))
    if not settings.subject:
        return Subject(settings.subject_name, default_skeleton(settings.subject_height), marker_set(settings))
    known = subject(absolute(settings.subject))
    return known if known.marker_set.name == KEYPOINTS else replace(known, marker_set=marker_set(settings))


def starter_database_path() -> Path:
    """Return the file of the starter database; a file with the old suffix remains in use."""
    folder = user_folder("databases")
    old = folder / f"starter{OLD_DATABASE_SUFFIX}"
    new = folder / f"starter{DATABASE_SUFFIX}"
    return old if old.exists() and not new.exists() else new


def uses_starter(settings: Any) -> bool:
    """Return True if the starter database is in use: no other is chosen, or its name is typed."""
    return settings.database in ("", STARTER)


def database_path(settings: Any) -> Path:
    """Return the file of the database in use."""
    return starter_database_path() if uses_starter(settings) else Path(absolute(settings.database))


def pictures(settings: Any) -> StepStatus:
    """Return the status of the source of images or trackers, ignoring calibration."""
    if is_known(settings):
        return ready("simulated")
    if not has_cameras(settings):
        chosen = settings.id_data.perfanim_receiving
        wrong = receiving_problem(chosen)
        return faulty("online access is off", wrong) if wrong else ready(f"port {chosen.port}")
    for name in source_paths(settings):
        path = absolute(getattr(settings, name))
        side = name.partition("_")[0]
        if not path:
            return faulty(f"{side} missing", f"choose the file of the {side} camera under Cameras")
        if not is_found(path):
            return faulty(f"{side} not found", f"{path}: not found; choose another under Cameras")
    if settings.source == "CAMERAS":
        try:
            devices(settings)
        except CaptureError as error:
            return faulty("check cameras", error)
    return ready("chosen")


def is_found(path: str) -> bool:
    """Return True if a file or folder exists, or the folder of a file pattern."""
    return exists(path) or (glob.has_magic(path) and exists(Path(path).parent))


def cameras(settings: Any) -> StepStatus:
    """Return the status of the Cameras panel."""
    source = pictures(settings)
    if not source.ready or is_known(settings) or not has_cameras(settings):
        return source
    if not settings.calibration:
        return _not_calibrated("calibrate the cameras, or open a calibration, under Cameras")
    if follows_person(settings) and not (found_network := network(settings)).ready:
        return found_network
    try:
        calibrated = rig(absolute(settings.calibration))
    except PerfanimError as error:
        return faulty("bad calibration", error)
    if settings.source == "CAMERAS" and not is_one_camera(settings):
        count = len(devices(settings))
        if count != len(calibrated):
            text = f"calibrated for {len(calibrated)} cameras, but {count} are chosen"
            return faulty(text, f"{text}: calibrate the chosen cameras, or open their calibration, under Cameras")
    if calibrated.metadata.get("verdict") == "redo":
        advice = "this calibration's own verdict is redo: calibrate the cameras again for a better capture"
        return StepStatus(StepState.READY, "calibrate again", doubt=advice)
    if is_one_camera(settings):
        return ready("one camera")
    apart = float(np.linalg.norm(calibrated.cameras[0].centre_m - calibrated.cameras[-1].centre_m))
    rms = calibrated.metadata.get("error")
    return ready(f"{rms:.2f} px, {apart:.2f} m" if isinstance(rms, float) else f"{apart:.2f} m apart")


def devices(settings: Any) -> tuple[int | str, ...]:
    """Return the device numbers or network addresses of the chosen cameras.

    Raises:
        CaptureError: An entry is neither a number nor an address, or one camera is chosen twice.
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
    """Return a camera's number, or its network address."""
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
    problem = f"{text!r} is not a device number or an address"
    raise CaptureError(problem, where="additional cameras", advice="enter numbers or addresses, such as 2, 3")


def is_one_camera(settings: Any) -> bool:
    """Return True if only the left camera is chosen or calibrated."""
    if settings.source == "SIMULATED" or not has_cameras(settings):
        return False
    if settings.source == "CAMERAS":
        alone = settings.right_device == NONE
    else:
        alone = not getattr(settings, "right_video" if settings.source == "VIDEOS" else "right_folder")
    calibrated = found(rig, absolute(settings.calibration)) if settings.calibration else None
    return alone or (calibrated is not None and len(calibrated) == 1)


def is_measured(settings: Any) -> bool:
    """Return True if the cameras can measure the performer in calibration poses."""
    measures = has_cameras(settings) and not is_one_camera(settings)
    return measures and not is_known(settings) and not follows_person(settings)


def source_paths(settings: Any) -> tuple[str, ...]:
    """Return the names of the settings that hold the files of the cameras in use."""
    both = {"VIDEOS": ("left_video", "right_video"), "IMAGES": ("left_folder", "right_folder")}
    return both.get(settings.source, ())[: 1 if is_one_camera(settings) else 2]


def markers(settings: Any) -> StepStatus:
    """Return the status of the Markers panel."""
    try:
        return ready(f"{len(marker_set(settings))} markers")
    except PerfanimError as error:
        return faulty("bad marker set", error)


def performer(settings: Any) -> StepStatus:
    """Return the status of the Subject panel."""
    if not settings.subject:
        if is_known(settings):
            return ready("simulated")
        if follows_person(settings):
            return ready(f"{settings.subject_height:.2f} m, average body")
        how = "calibrate the performer" if is_measured(settings) else "use an average body"
        return _not_calibrated(f"{how}, or open a subject file, under Subject")
    try:
        chosen = subject(absolute(settings.subject))
    except PerfanimError as error:
        return faulty("bad file", error)
    worn = None if follows_person(settings) else found(marker_set, settings)
    try:
        chosen.wearing(worn or chosen.marker_set)  # a damaged marker set is reported by its own step
    except SubjectError as error:
        return faulty("other markers", error)
    return ready(performer_text(absolute(settings.subject)))


def performer_text(path: str) -> str:
    """Return name and residual of a subject file in a few words."""
    known = found(subject, path)
    if known is None:
        return f"{Path(path).stem} (bad file)"
    return f"{known.name}, {known.residual_m * 1000:.0f} mm" if known.residual_m else f"{known.name}, average body"


def motion(settings: Any) -> StepStatus:
    """Return the status of the Motion Database panel."""
    path = database_path(settings)
    if uses_starter(settings) and not exists(path):
        return ready("starter")
    try:
        frames = database_frames(str(path))
    except PerfanimError as error:
        return faulty("bad database", error)
    return ready(f"{frames / 1000:.0f}k frames" if frames >= 10_000 else f"{frames} frames")


def character(settings: Any) -> StepStatus:
    """Return the status of the Character panel."""
    armature = settings.armature
    if armature is None:
        active = active_armatures(bpy.context)
        return ready(f"use {active[0].name}?" if len(active) == 1 else "new at start")
    problem = map_problem(armature)
    text = "cannot be driven" if armature.users_scene else "deleted"
    return faulty(text, f"{armature.name}: {problem}") if problem else ready(armature.name)


STEPS = (cameras, markers, performer, motion, character)


def first_missing_step(settings: Any) -> str:
    """Return the problem of the first step that is not ready, or ""."""
    return next((state.problem for step in STEPS if not (state := step(settings)).ready), "")
