"""Solving whole takes into motions."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body.motion import Motion
from ..body.scene_pose import ScenePose
from ..database.store import Database
from ..formats.take_file.take_reader import TakeFile
from ..markers.filtering import smooth_on_body
from ..markers.gap_filling import fill_gaps, widen_gaps
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_take import MarkerTake
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from ..markers.take_frames import take_frames
from ..solver.settings import SolveSettings
from ..system.progress import Progress
from .capture_setup import CaptureSetup, SessionMaker
from .delayed_poses import calm_poses
from .multi_target_session import MultiTargetSession
from .recorded_frames import relabel
from .session import Session
from .solved_take import SolvedTake
from .steady_motion import motion_of, pose_clock, steady_motion

_REPORT_EVERY = 30  # frames between two reports of progress
_LIVE_SHARE = 0.7  # share of the progress of `solve_frames` reserved for the live solve
_LABELS_SHARE = 0.25  # share of the whole progress reserved for labels, before the solve in both directions


def solve_take(
    take: MarkerTake,
    subject: Subject,
    database: Database,
    settings: SolveSettings,
    progress: Progress,
    sessions: SessionMaker = Session,
    causal: bool = False,
) -> SolvedTake:
    """Solve a labelled take, including markers seen by single cameras.

    Args:
        causal: Solve each pose from earlier frames only, as in a live capture, instead of in both directions of time
            (`two_way_solve`).
    """
    setup = CaptureSetup(take.single.rig if take.single else None, (subject,), (), database, settings)
    frames = list(take_frames(take, subject.marker_set))
    session = setup.make_session(sessions)
    solved = _solve_whole(frames, session, f"solving {take.name}", progress, causal, not take.is_trusted)
    clock = pose_clock(solved.poses, take.name, take.fps)
    motion = steady_motion(solved.poses_of(), subject, take.name, clock)
    return replace(solved, motions=(motion,), clock=clock, setup=setup, frames=[(0.0, frame) for frame in frames])


def fill_take(
    take: MarkerTake, subject: Subject, database: Database, noise_hz: float | None, progress: Progress
) -> tuple[MarkerTake, SolvedTake]:
    """Return a labelled take with its gaps filled by means of the solved body, and the solved take.

    Args:
        noise_hz: Cut-off for filtering the measured markers (see `smooth_on_body`); None for no filter.
    """

    def solved_body(seen: MarkerTake) -> tuple[SolvedTake, Motion]:
        solved = solve_take(seen, subject, database, SolveSettings(), progress)
        return solved, motion_of(solved.poses_of(), subject, take.name, take.fps)

    solved, body = solved_body(widen_gaps(take))
    filled = fill_gaps(take, subject.marker_set, body)
    if noise_hz is None:
        return filled, solved
    solved, body = solved_body(filled)
    return smooth_on_body(filled, subject.marker_set, body, noise_hz), solved


def solve_recorded(
    take: TakeFile,
    frames: Sequence[MarkerFrame],
    setup: CaptureSetup,
    progress: Progress,
    sessions: SessionMaker = Session,
    causal: bool = False,
) -> SolvedTake:
    """Solve a recorded take; its motions begin after the countdown.

    Args:
        frames: Marker frames of the take, or others made from its 2D detections.
        causal: Find labels and poses from earlier frames only, as in a live capture.

    Raises:
        TakeError: There are no two frames with different times.
    """
    name = take.notes.name
    solved = _solve_whole(frames, setup.make_session(sessions), f"solving {name}", progress, causal)
    recorded = [pose for pose in solved.poses if take.is_recorded(pose.number)]
    clock = pose_clock(recorded, str(take.path))
    motions = tuple(
        steady_motion([pose.performers[index] for pose in recorded], subject, name, clock)
        for index, subject in enumerate(setup.performers)
    )
    stamped = [(stamp_s, frame) for (stamp_s, _), frame in zip(take.stamped_frames, frames, strict=True)]
    return replace(solved, motions=motions, clock=clock, setup=setup, frames=stamped, recording=take)


def _solve_whole(
    frames: Sequence[MarkerFrame],
    session: MultiTargetSession,
    activity: str,
    progress: Progress,
    causal: bool,
    check_labels: bool = True,
) -> SolvedTake:
    """Return the poses of all frames, solved in both directions of time or, if `causal`, as a capture shows them."""
    if causal:
        live = solve_frames(frames, session, activity, progress, causal, check_labels)
        return replace(live, poses=tuple(calm_poses(live.poses, noise_of(session.subjects[0].marker_set.points))))

    def first(share: float, text: str) -> None:
        progress(_LABELS_SHARE * share, text)

    solved = solve_frames(frames, session, activity, first, check_labels=check_labels)

    def later(share: float) -> None:
        progress(_LABELS_SHARE + (1.0 - _LABELS_SHARE) * share, f"{activity} in both directions")

    return replace(solved, poses=tuple(session.solve_two_ways(solved.poses, later)))


def solve_frames(
    frames: Sequence[MarkerFrame],
    session: MultiTargetSession,
    activity: str,
    progress: Progress,
    causal: bool = False,
    check_labels: bool = True,
) -> SolvedTake:
    """Return the poses of frames, without motions; `check_labels` as in `Session.step`.

    Labels that the session finds or replaces also apply to earlier frames, as far back as they explain the markers
    better; if `causal`, they apply from then on only, as in a live capture.
    """
    poses: list[ScenePose] = []
    seconds, begun = [], []
    for i, frame in enumerate(frames):
        if i % _REPORT_EVERY == 0:
            progress(_LIVE_SHARE * i / len(frames), activity)
        start, before = time.perf_counter(), session.labellings
        poses.append(session.step(frame, check_labels))
        seconds.append(time.perf_counter() - start)
        if session.labellings != before:
            begun.append(i + 1)
    if causal:
        return SolvedTake(tuple(poses), (), np.array(seconds), np.zeros(len(poses), dtype=bool))

    def later(share: float) -> None:
        progress(_LIVE_SHARE + (1.0 - _LIVE_SHARE) * share, f"{activity} again")

    found, relabelled = relabel(frames, poses, [at for at in begun if at < len(frames)], session, later)
    return SolvedTake(tuple(found), (), np.array(seconds), relabelled)
