"""Steps of the guide for cameras, judged by `readiness` or by the last check of the pictures."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import bpy

from ...core.subjects.setup_check.finding import PICTURE_FAULTS, Fault, Place
from ..preferences.paths import absolute
from . import readiness
from .camera_choice import are_there
from .readiness import StepState, StepStatus

_PICTURES = (
    "source",
    "follow",
    "practise",
    "practise_fault",
    "left_device",
    "right_device",
    "left_address",
    "right_address",
    "further_devices",
    "left_video",
    "right_video",
    "left_folder",
    "right_folder",
)
_TODO = StepStatus(StepState.TO_DO, "to do")
_DONE = readiness.ready("done")


@dataclass(frozen=True)
class GuideStep:
    """A step: a sentence and a button; its functions receive the settings."""

    title: str
    text: Callable[[Any], str]
    operator: Callable[[Any], str]  # name of the button's operator
    panel: str  # key of the panel that shows the operator's progress and result
    state: Callable[[Any], StepStatus]
    drawn: tuple[str, ...] = ()  # settings shown above the button
    passing: Callable[[Any], str] = lambda settings: ""  # label of the button that skips an optional step
    follows: str = ""  # the step is only for this choice of `follow`


@dataclass
class Seen:
    """Results of the last check and capture, with their settings, and skipped steps."""

    pictures: tuple[Any, ...] = ()
    setup: tuple[Any, ...] = ()
    findings: tuple[tuple[str, str], ...] = ()
    reflections: dict[int, Place] = field(default_factory=dict)  # by their number in the picture
    walk: str = ""  # verdict on the last capture
    is_walked: bool = False  # whether that capture was long enough for a verdict
    space: str = ""
    skipped: dict[str, tuple[Any, ...]] = field(default_factory=dict)

    def forget(self) -> None:
        """Forget everything."""
        vars(self).update(vars(Seen()))

    def forget_pictures(self) -> None:
        """Forget the last check, because ignored positions have changed."""
        self.pictures, self.setup = (), ()


seen = Seen()


def keep_check(settings: Any, summary: Mapping[str, Any]) -> None:
    """Keep the result of the job `check setup` for these settings."""
    seen.pictures, seen.setup = _pictures(settings), _setup(settings)
    seen.findings = tuple((str(row["fault"]), str(row["text"])) for row in summary["findings"])
    found = [row.get("places", ()) for row in summary["findings"] if row["fault"] == Fault.REFLECTION]
    seen.reflections = dict(enumerate((place for places in found for place in places), 1))
    seen.space = str(summary["space"])


def reflections(settings: Any) -> dict[int, Place]:
    """Return the reflections that the last check found in these pictures, by number."""
    return dict(seen.reflections) if seen.pictures == _pictures(settings) else {}


def forgive_reflections(numbers: Iterable[int]) -> bool:
    """Remove reflections from the last check because they are now ignored; return whether none is left."""
    for number in numbers:
        seen.reflections.pop(number, None)
    seen.setup = ()
    if not seen.reflections:
        seen.findings = tuple(row for row in seen.findings if row[0] != Fault.REFLECTION)
    return not seen.reflections


def skip(settings: Any) -> None:
    """Skip the next step as long as the pictures come from the same source."""
    seen.skipped[next_step(settings)[1].title] = _pictures(settings)


def is_skipped(settings: Any, step: GuideStep) -> bool:
    """Return whether a step counts as passed only because it was skipped."""
    return not step.state(settings).ready and seen.skipped.get(step.title) == _pictures(settings)


def space(settings: Any) -> str:
    """Return a description of the space that all cameras see, from the last check; "" if unknown."""
    return seen.space if seen.setup == _setup(settings) else ""


def next_step(settings: Any) -> tuple[int, GuideStep, StepStatus]:
    """Return index, step and status of the first step that is not done."""
    chosen = steps(settings)
    for number, step in enumerate(chosen[:-1]):
        state = step.state(settings)
        if not state.ready and not is_skipped(settings, step):
            return number, step, state
    return len(chosen) - 1, chosen[-1], _TODO


def steps(settings: Any) -> tuple[GuideStep, ...]:
    """Return the steps for markers, or those for a person without markers."""
    follows = "PERSON" if readiness.follows_person(settings) else "MARKERS"
    return tuple(step for step in STEPS if step.follows in ("", follows))


def _pictures(settings: Any) -> tuple[Any, ...]:
    return tuple(getattr(settings, name) for name in _PICTURES)


def _setup(settings: Any) -> tuple[Any, ...]:
    return (*_pictures(settings), absolute(settings.calibration), readiness.marker_set_source(settings))


def _source(settings: Any) -> StepStatus:
    state = readiness.pictures(settings)
    if not state.ready:
        return state
    # device numbers are a guess until the pictures have been seen
    unseen = settings.source == "CAMERAS" and not settings.calibration and seen.pictures != _pictures(settings)
    return _TODO if unseen or readiness.is_known(settings) else state


def _exposure(settings: Any) -> StepStatus:
    if not readiness.has_cameras(settings):
        return _DONE
    if seen.pictures != _pictures(settings):
        return _TODO
    # the step Markers shows what is found with a calibration; without one, everything was found in the pictures
    return _judged([text for fault, text in seen.findings if fault in PICTURE_FAULTS or not settings.calibration])


def _calibrated(settings: Any) -> StepStatus:
    """Return the status of the cameras, which are to be calibrated again if the calibration's own verdict says so."""
    state = readiness.cameras(settings)
    return _TODO if state.doubt else state


def _floor(settings: Any) -> StepStatus:
    if not readiness.has_cameras(settings):
        return _DONE
    rig = readiness.found(readiness.rig, absolute(settings.calibration))
    return _DONE if rig is not None and "floor" in rig.metadata else _TODO


def _worn(settings: Any) -> StepStatus:
    state = readiness.markers(settings)
    if not state.ready or not readiness.has_cameras(settings):
        return state
    return _TODO if seen.setup != _setup(settings) else _judged([text for _, text in seen.findings])


def _judged(problems: list[str]) -> StepStatus:
    return readiness.faulty("fix first", "\n".join(problems)) if problems else _DONE


def _always(name: str) -> Callable[[Any], str]:
    return lambda settings: name


def _live_or_recorded(live: str, recorded: str) -> Callable[[Any], str]:
    return lambda settings: recorded if settings.source in ("VIDEOS", "IMAGES") else live


def _floor_text(settings: Any) -> str:
    is_recorded = settings.source in ("VIDEOS", "IMAGES")
    if readiness.follows_person(settings):
        otherwise = "skip this step" if is_recorded else "lay the board on the floor where you will stand"
        return f"Check Setup finds the floor under the feet. If it did not, {otherwise}."
    if is_recorded:
        return "Recorded images set no floor here. Skip this step: the floor is found from the feet in the T pose."
    return "Lay the board on the floor where you will stand."


def _calibrating(settings: Any) -> str:
    if readiness.follows_person(settings) and not readiness.is_one_camera(settings):
        return "calibrate_walking"
    return "calibrate_board" if settings.source in ("CAMERAS", "SIMULATED") else "calibrate_cameras"


def _measuring(settings: Any) -> str:
    return "calibrate_performer" if readiness.is_measured(settings) else "average_performer"


def _calibrating_text(settings: Any) -> str:
    if _calibrating(settings) == "calibrate_walking" and settings.source == "CAMERAS":
        return "Type your height, click, then walk about for 20 s where both cameras see all of you."
    if _calibrating(settings) == "calibrate_walking":
        return "Type the height of the person, who walks about for 20 s where both cameras see all of them, and click."
    if _calibrating(settings) == "calibrate_board":
        return "Hold the board in front of the cameras, still for a moment in each place that the preview asks for."
    return "Choose the folders with each camera's pictures of the board, or a calibration under Cameras."


_POSES_TEXT = _live_or_recorded(
    "Leave the view empty, click, then take the three poses of the countdown.",
    "Needs a recording that begins with the empty view and shows the three poses.",
)


def _measuring_text(settings: Any) -> str:
    if _measuring(settings) == "calibrate_performer":
        return _POSES_TEXT(settings)
    return "Type your height and click: a body of average proportions is used."


_SKIP = _always("Skip This Step")

EXPOSURE = GuideStep(
    "Exposure",
    _live_or_recorded(
        "Leave the view empty, click, then stand in front of the cameras with the markers on and walk about.",
        "Click to look through the recording. It should begin with the empty view.",
    ),
    _always("check_setup"),
    "guide",
    _exposure,
    ("practise_fault",),
    passing=_SKIP,
    follows="MARKERS",
)

STEPS = (
    GuideStep(
        "Cameras",
        _always("Choose the cameras, or Practise Calibration to try all steps on simulated ones."),
        lambda settings: "show_cameras" if settings.source == "CAMERAS" else "",
        "guide",
        _source,
        passing=lambda settings: (
            "Use These Cameras"
            if settings.source == "CAMERAS" and readiness.pictures(settings).ready and are_there(settings)
            else ""
        ),
    ),
    EXPOSURE,
    GuideStep(
        "Body Network",
        _always("A neural network finds you in the pictures. It is downloaded once, or taken from a file."),
        _always("get_body_network"),
        "cameras",
        readiness.network,
        follows="PERSON",
    ),
    GuideStep(
        "Calibrate",
        _calibrating_text,
        _calibrating,
        "cameras",
        _calibrated,
        ("board_columns", "board_rows", "board_square_mm", "board_left", "board_right", "subject_height"),
        passing=lambda settings: "Use This Calibration" if readiness.cameras(settings).ready else "",
    ),
    GuideStep(
        "Person",
        _live_or_recorded(
            "Type your height. Click, then walk about where both cameras see you from head to foot.",
            "Type the height of the person and click. The recording should show the whole body.",
        ),
        _always("check_setup"),
        "guide",
        _worn,
        ("subject_height",),
        passing=_SKIP,
        follows="PERSON",
    ),
    GuideStep(
        "Floor",
        _floor_text,
        _always("set_floor"),
        "cameras",
        _floor,
        passing=_SKIP,
    ),
    GuideStep(
        "Markers",
        _live_or_recorded(
            "Put on the markers of the set. Leave the view empty, click, then hold a T pose and walk about.",
            "Choose the set that was worn and click. The recording should show a T pose and a walk.",
        ),
        _always("check_setup"),
        "guide",
        _worn,
        ("marker_set", "practise_fault"),
        passing=_SKIP,
        follows="MARKERS",
    ),
    GuideStep(
        "Performer",
        _measuring_text,
        _measuring,
        "subject",
        readiness.performer,
        ("subject_name", "subject_height"),
    ),
    GuideStep(
        "Database",
        _always("Choose motion like yours, or the starter database."),
        _always("use_starter_database"),
        "database",
        readiness.motion,
    ),
    GuideStep(
        "Character",
        _always("Choose the character to move, or none for a new one."),
        _always("use_active_armature"),
        "character",
        readiness.character,
        ("armature",),
    ),
    GuideStep(
        "Capture",
        _live_or_recorded(
            "All is ready. Walk about for ten seconds as a test, then stop: the guide says how good captures will be.",
            "All is ready. Click: at the end of the recording the guide says how good the capture was.",
        ),
        _always("start_capture"),
        "capture",
        lambda _: _TODO,
    ),
)


@bpy.app.handlers.persistent
def _forget_other_file(*_: object) -> None:
    seen.forget()


def register() -> None:
    """Forget all results, now and when another file is loaded."""
    seen.forget()
    bpy.app.handlers.load_post.append(_forget_other_file)


def unregister() -> None:
    """Undo `register`."""
    seen.forget()
    bpy.app.handlers.load_post.remove(_forget_other_file)
