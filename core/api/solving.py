"""Solving takes, for commands and scripts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ..body.foot_lock import FEET, floor_of, hold_feet
from ..body.motion import Motion
from ..body.skeleton import marker_positions
from ..database.starter_database import starter_database
from ..database.store import Database, check_file, identity
from ..errors import SubjectError, TakeError
from ..formats.markers.recorded_take import marker_take
from ..formats.take_file.take_reader import TakeFile
from ..geometry.arrays import runs
from ..geometry.camera import CameraRig
from ..markers.filtering import smooth_motion, smooth_take
from ..markers.label_faults import correct_labels, told
from ..markers.label_matching import AUTO
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.prop import Prop
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from ..markers.take_frames import is_unnamed
from ..session.capture_setup import CaptureSetup
from ..session.session_cache import SessionCache
from ..session.solve_take import solve_recorded, solve_take
from ..session.solved_take import SolvedTake
from ..session.steady_motion import motion_of
from ..session.verdict import Reason, ReasonKind
from ..solver.marker_selection import choose_markers, with_markers, worn_in
from ..solver.settings import METHODS, SolveSettings
from ..subjects.contradictions import contradicted_places, moved_markers
from ..subjects.refine_body import refine_body
from ..subjects.refinement_text import worthwhile
from ..subjects.unknown_marker_placement import place_markers
from ..system.progress import Progress, no_progress
from ..system.schema import About, check_ranges
from .calibration import fit_subject
from .coverage_findings import with_coverage
from .take_reading import choose_worn, fit_take, labelled_by

Facts = dict[str, Any]


@dataclass(frozen=True)
class SolveRequest:
    """Settings of a solve."""

    method: Annotated[
        str | None, About("solver method (default: best, or for a recorded take the recorded one)", choices=METHODS)
    ] = None
    causal: Annotated[
        bool, About("solve each frame from earlier frames only, as live (default: from earlier and later ones)")
    ] = False
    refine_body: Annotated[
        bool, About("first correct the performer's bones and marker offsets with this take; no file is changed")
    ] = False
    trust_labels: Annotated[
        bool,
        About(
            "use a marker take's labels as they are (default: exchanged, frozen and outlying ones are found and listed "
            "as doubtful)"
        ),
    ] = False
    smooth_hz: Annotated[
        float | None,
        About(
            "cut-off of a zero-lag low-pass filter for a marker take's trajectories and for the motion; 6 Hz and above "
            "preserve a walk (default: no filter)",
            "Hz",
            above=0.0,
        ),
    ] = None
    feet: Annotated[
        str,
        About("feet to hold in place: auto, planted feet; always, the lower foot even while it slides", choices=FEET),
    ] = "off"
    markers: Annotated[
        tuple[str, ...], About("markers of a marker take to solve with; the others measure the error (default: all)")
    ] = ()
    place_markers: Annotated[
        bool, About("from a marker take's motion, find the offsets of markers unknown to the performer's set")
    ] = False
    height_m: Annotated[
        float | None,
        About("height of a performer who is fitted to the motion (default: estimated)", "m", 1.0, 2.5),
    ] = None
    marker_count: Annotated[
        int | None, About("number of markers to solve with, chosen to determine the body best (default: all)")
    ] = None

    def __post_init__(self) -> None:
        check_ranges(self)


AS_USUAL = SolveRequest()


def solve(
    take: MarkerTake | TakeFile,
    subject: Subject | None = None,
    database: Database | Path | str | None = None,
    request: SolveRequest = AS_USUAL,
    progress: Progress = no_progress,
) -> SolvedTake:
    """Return the full-body poses and motion of a take.

    Args:
        take: Marker take, or recorded take. As by `load_take`, the labels of a marker take are matched, and unless it
            is upright already, the axis along which the performer stands becomes y.
        subject: Performer; None for a recorded take's own performer, or to fit one to a marker take's motion as by
            `fit_subject`.
        database: Motion database or its file; None for the one named in a recorded take, or else the starter database.
        request: How to solve.
        progress: Called with the fraction done and the activity.

    Raises:
        SubjectError: No performer is known.
        TakeError: The take has too few markers of the performer, the body's size is not human, or the vertical cannot
            be found.
        DatabaseError: The database is missing or damaged, or changed during the solve.
    """
    if isinstance(take, TakeFile):
        return solve_recording(take, request, RecordingChanges(subject), database, progress)
    database = starter_database(progress) if database is None else database
    if subject is None:
        opened = _opened(database, SessionCache())
        take, worn = labelled_by(AUTO, take, opened, progress=progress)
        request = replace(request, place_markers=True)
        return solve_unmeasured(fit_take(take, worn, "auto"), AUTO, opened, request, progress)
    return solve_markers(fit_take(take, subject.marker_set, "auto"), subject, database, request, progress)


def solve_unmeasured(
    take: MarkerTake,
    marker_set: MarkerSet | str,
    database: Database | Path | str,
    request: SolveRequest = AS_USUAL,
    progress: Progress = no_progress,
    cache: SessionCache | None = None,
) -> SolvedTake:
    """Solve a y-up take of a performer who is fitted to its motion first; see `fit_subject` and `solve`."""
    cache = cache or SessionCache()
    opened = _opened(database, cache)
    subject = fit_subject(
        take, opened, marker_set, request.height_m, progress=lambda share, text: progress(0.5 * share, text)
    )
    solved = solve_markers(take, subject, opened, request, lambda share, text: progress(0.5 + 0.5 * share, text), cache)
    moved_m = moved_markers(subject, choose_worn(marker_set, take))
    text = contradicted_places(moved_m)
    return replace(
        solved,
        findings=(*solved.findings, *([Reason(ReasonKind.LIMB, text)] if text else [])),
        report=solved.report
        | {
            "residual_mm": 1e3 * subject.residual_m,
            "moved_mm": {name: 1e3 * moved for name, moved in moved_m.items()},
        },
    )


def solve_markers(
    take: MarkerTake,
    subject: Subject,
    database: Database | Path | str,
    request: SolveRequest = AS_USUAL,
    progress: Progress = no_progress,
    cache: SessionCache | None = None,
) -> SolvedTake:
    """Solve a y-up take with the marker names of the subject's set; arguments and errors are those of `solve`.

    Args:
        cache: Cache shared by takes that are solved one after another.
    """
    cache = cache or SessionCache()
    opened, settings = _opened(database, cache), SolveSettings(method=request.method or "best")
    take, faults = (take, ()) if request.trust_labels or is_unnamed(take) else correct_labels(take, subject)
    corrected = tuple(fault.stretch(take) for fault in faults)
    if request.smooth_hz is not None:
        take = smooth_take(take, request.smooth_hz)
    if request.place_markers:
        subject = place_markers(take, subject, opened, progress)
    subject, changes = _refined(take, subject, opened, request, progress)
    worn, choice = _choose_worn(take, subject, opened, request)
    take = replace(take, is_trusted=request.trust_labels)
    solved = solve_take(take, worn, opened, settings, progress, cache.session, request.causal)
    check_file(opened)
    if choice:
        body = motion_of(solved.poses_of(), worn, take.name, take.fps)
        choice["left_out_rms_mm"] = 1e3 * _left_out_rms_m(take, subject, worn, body)
    report = {
        "method": settings.method,
        "marker_set": subject.marker_set.name,
        "markers": sum(name in take.names for name in subject.marker_set.names),
        "cut_off_frames": take.cut_off_frames,
        "warnings": [*_label_differences(take, subject), *take.notes, *told(corrected), *_told_times(solved)],
    }
    solved, report = replace(solved, corrected=corrected), report | changes | choice
    if not is_unnamed(take):
        solved, report["coverage"] = with_coverage(solved, take, subject, worn.marker_set)
    return _finished(solved, request, worn, None, report)


@dataclass(frozen=True)
class RecordingChanges:
    """Replacements for parts of a recorded take's set-up; empty values keep the recorded part.

    Args:
        subject: First, or only, performer.
        performers: Further performers.
        rig: Calibrated cameras, with which the 2D detections are triangulated again.
    """

    subject: Subject | None = None
    performers: Sequence[Subject] = ()
    props: Sequence[Prop] = ()
    rig: CameraRig | None = None


def solve_recording(
    take: TakeFile,
    request: SolveRequest = AS_USUAL,
    changes: RecordingChanges = RecordingChanges(),
    database: Database | Path | str | None = None,
    progress: Progress = no_progress,
    cache: SessionCache | None = None,
) -> SolvedTake:
    """Solve a recorded take again; arguments and errors are those of `solve`.

    Args:
        cache: Cache shared by takes that are solved one after another.
    """
    cache, where, recorded = cache or SessionCache(), str(take.path), take.setup.subjects()
    rig = changes.rig or take.setup.camera_rig()
    frames = _located(take, changes.rig, request.causal, progress)
    subject = changes.subject or (recorded[0] if recorded else None)
    if subject is None:
        raise SubjectError("names no performer", where=where, advice="name a subject, or a skeleton and a marker set")
    settings, named = _settings(take, request.method), take.setup.database.get("path", "")
    if database is None and not named:
        raise TakeError("names no motion database", where=where, advice="name one")
    opened = _opened(named if database is None else database, cache)
    subject, refined = _refined(take, subject, opened, request, progress)
    setup = CaptureSetup(
        rig,
        (subject, *(changes.performers or recorded[1:])),
        tuple(changes.props or take.setup.carried_props()),
        opened,
        settings,
    )
    solved = solve_recorded(take, frames, setup, progress, cache.session, request.causal)
    check_file(opened)
    has_changed = database is None and identity(opened)["sha256"] != take.setup.database.get("sha256")
    report = {
        "method": settings.method,
        "warnings": [
            *take.problems,
            *([f"{named} has changed since the take was recorded"] if has_changed else []),
            *_told_times(solved),
        ],
        "complete": take.complete,
    }
    finished = _finished(solved, request, setup.performers[0], floor_of(rig), report | refined)
    return replace(finished, report=finished.report | _recorded_figures(finished, setup))


def _located(take: TakeFile, changed: CameraRig | None, is_causal: bool, progress: Progress) -> Sequence[MarkerFrame]:
    """Return the frames, triangulated again if the calibration has changed.

    A person without markers is always located again from the 2D points, unless the take is solved causally: later
    frames help to tell left from right.
    """
    rig = changed or take.setup.camera_rig()
    is_person = bool(take.setup.capture.get("people"))
    if rig is None or (changed is None and (is_causal or not is_person)):
        return take.frames
    from ..vision.tracked_take import check_cameras, relocate, retriangulate  # OpenCV is slow to load

    progress(0.0, "triangulating again")
    check_cameras(rig, take.frames)
    return relocate(rig, take.frames) if is_person else retriangulate(rig, take.frames)


def _told_times(solved: SolvedTake) -> list[str]:
    return solved.clock.sentences if solved.clock is not None else []


def _opened(database: Database | Path | str, cache: SessionCache) -> Database:
    return database if isinstance(database, Database) else cache.database(database)


def _refined(
    take: MarkerTake | TakeFile, subject: Subject, database: Database, request: SolveRequest, progress: Progress
) -> tuple[Subject, Facts]:
    """Return the subject, refined with the take if requested, and the changes in words."""
    if not request.refine_body:
        return subject, {}
    labelled = marker_take(take) if isinstance(take, TakeFile) else take
    found = refine_body(labelled, subject, database, lambda share, text: progress(0.2 * share, text))
    subject, changes = worthwhile(subject, found)
    return subject, {"changes": changes}


def _choose_worn(
    take: MarkerTake, subject: Subject, database: Database, request: SolveRequest
) -> tuple[Subject, Facts]:
    """Return the subject with only the markers used for solving, and facts about how they were chosen."""
    if request.markers:
        worn = with_markers(subject, list(request.markers))
        return worn, {"used": list(worn.marker_set.names)}
    worn = worn_in(take, subject)
    if request.marker_count is None:
        return worn, {}
    choice = choose_markers(worn, database, request.marker_count)
    expected_mm = (1e3 * choice.expected_m).round(1).tolist()
    return with_markers(worn, choice.names), {"used": list(choice.names), "expected_mm": expected_mm}


def _left_out_rms_m(take: MarkerTake, subject: Subject, worn: Subject, motion: Motion) -> float:
    """Return the RMS error of the markers that were left out of the solve, or NaN if there are none."""
    suit = subject.marker_set
    left_out = [i for i, name in enumerate(suit.names) if name in take.names and name not in worn.marker_set.names]
    if not left_out:
        return float("nan")
    joints, offsets_m = suit.joint_indices(motion.skeleton)[left_out], suit.offsets_m[left_out]
    solved = marker_positions(motion.skeleton, joints, offsets_m, motion.rotations, motion.root_positions_m)
    measured = take.positions_m[:, [take.names.index(suit.names[i]) for i in left_out]]
    return float(np.sqrt(np.nanmean(np.sum((solved - measured) ** 2, axis=-1))))


def _label_differences(take: MarkerTake, subject: Subject) -> list[str]:
    """Return warnings about labels found only in the take or only in the subject."""
    if is_unnamed(take):
        return []
    worn = subject.marker_set.names
    lacking = ", ".join(name for name in worn if name not in take.names)
    unused = ", ".join(name for name in take.names if name not in worn)
    warnings = [f"not in the take: {lacking}"] if lacking else []
    return [*warnings, f"not in the marker set, left out: {unused}"] if unused else warnings


def _settings(take: TakeFile, method: str | None) -> SolveSettings:
    """Return the recorded settings, with the method replaced if another is named."""
    given = dict(take.setup.settings) | ({"method": method} if method else {})
    try:
        return SolveSettings.of_table(given)
    except TypeError as error:
        advice = f"solve it with {take.setup.software or 'the version that recorded it'}"
        what = f"was solved with settings unknown to this version ({error})"
        raise TakeError(what, where=str(take.path), advice=advice) from error


def _recorded_figures(solved: SolvedTake, setup: CaptureSetup) -> Facts:
    """Return the relabelled stretches, in seconds from the start, and figures for props and the other performers."""
    times_s = [pose.time_s - solved.poses[0].time_s for pose in solved.poses]
    figures: Facts = {
        "relabelled": [
            {"start_s": times_s[start], "stop_s": times_s[stop - 1]} for start, stop in runs(solved.relabelled)
        ],
    }
    poses = solved.recorded_poses()
    if setup.props:
        found = ([pose.props[index].found for pose in poses] for index in range(len(setup.props)))
        figures["props"] = {prop.name: sum(row) / len(poses) for prop, row in zip(setup.props, found, strict=True)}
    if setup.performers[1:]:
        figures["performers"] = [
            {
                "name": subject.name,
                "confidence": float(np.mean([pose.performers[index].confidence for pose in poses])),
                "verdict": solved.verdict_of(index).text,
            }
            for index, subject in enumerate(setup.performers[1:], 1)
        ]
    return figures


def _finished(
    solved: SolvedTake, request: SolveRequest, performer: Subject, floor_m: float | None, report: Facts
) -> SolvedTake:
    """Return the take with smoothed motion and feet held in place, and the report."""
    if request.smooth_hz is None and request.feet == "off":
        return replace(solved, report=report)

    lasting_m = noise_of(performer.marker_set.points).lasting_m

    def finish(motion: Motion) -> Motion:
        calm = motion if request.smooth_hz is None else smooth_motion(motion, request.smooth_hz)
        return hold_feet(calm, request.feet, floor_m, lasting_m)

    return replace(solved, motions=tuple(map(finish, solved.motions)), finish=finish, report=report)
