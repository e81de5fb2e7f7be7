"""Solving of whole takes to motions."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body.motion import Motion
from ..body.scene_pose import PerformerPose, ScenePose
from ..database.store import Database
from ..errors import TakeError
from ..formats.take_file.take_reader import TakeFile
from ..geometry import rotations as rot
from ..markers.filtering import smooth_on_body
from ..markers.frame_rate import frame_rate
from ..markers.gap_filling import fill_gaps, widen_gaps
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import take_frames
from ..solver.settings import SolveSettings
from ..system.progress import Progress
from .capture_setup import CaptureSetup, SessionMaker
from .multi_target_session import MultiTargetSession
from .recorded_frames import relabel
from .session import Session
from .solved_take import SolvedTake

_LIVE_SHARE = 0.7  # share of the progress of `solve_frames` that the live labels take
_LABELS_SHARE = 0.25  # share of the whole progress that labels take before the solution in both directions
_REPORT_EVERY = 30  # frames between two reports of progress


def solve_take(
    take: MarkerTake,
    subject: Subject,
    database: Database,
    settings: SolveSettings,
    progress: Progress,
    sessions: SessionMaker = Session,
    causal: bool = False,
) -> SolvedTake:
    """Solve a labelled take, also with its markers seen by single cameras.

    Args:
        causal: Solve each pose from earlier frames only, as live, instead of in both directions (`two_way_solve`).
    """
    setup = CaptureSetup(take.single.rig if take.single else None, (subject,), (), database, settings)
    frames = list(take_frames(take, subject.marker_set))
    solved = _solve_whole(frames, setup.make_session(sessions), f"solving {take.name}", progress, causal)
    motion = motion_of(solved.poses_of(), subject, take.name, take.fps)
    return replace(solved, motions=(motion,), setup=setup, frames=[(0.0, frame) for frame in frames])


def fill_take(
    take: MarkerTake, subject: Subject, database: Database, noise_hz: float | None, progress: Progress
) -> tuple[MarkerTake, SolvedTake]:
    """Return a labelled take with its gaps filled by the body, and the solved body.

    Args:
        noise_hz: Cut-off to which measured markers are low-passed with the help of the body; None for no filter.
    """
    solved = solve_take(widen_gaps(take), subject, database, SolveSettings(), progress)
    filled = fill_gaps(take, subject.marker_set, solved.motion)
    if noise_hz is None:
        return filled, solved
    solved = solve_take(filled, subject, database, SolveSettings(), progress)
    return smooth_on_body(filled, subject.marker_set, solved.motion, noise_hz), solved


def solve_recorded(
    take: TakeFile,
    frames: Sequence[MarkerFrame],
    setup: CaptureSetup,
    progress: Progress,
    sessions: SessionMaker = Session,
    causal: bool = False,
) -> SolvedTake:
    """Solve a recorded take; its motions leave out the countdown.

    Args:
        frames: Its marker frames, or others made from its 2D detections.
        causal: Find labels and poses from earlier frames only, as live.

    Raises:
        TakeError: There are fewer than two frames.
    """
    name = take.notes.name
    solved = _solve_whole(frames, setup.make_session(sessions), f"solving {name}", progress, causal)
    recorded = [pose for pose in solved.poses if take.is_recorded(pose.number)]
    motions = tuple(
        resample_uniform([pose.performers[index] for pose in recorded], subject, name, str(take.path))
        for index, subject in enumerate(setup.performers)
    )
    stamped = [(stamp_s, frame) for (stamp_s, _), frame in zip(take.stamped_frames, frames, strict=True)]
    return replace(solved, motions=motions, setup=setup, frames=stamped, recording=take)


def _solve_whole(
    frames: Sequence[MarkerFrame], session: MultiTargetSession, activity: str, progress: Progress, causal: bool
) -> SolvedTake:
    """Return the poses of all frames, in both directions unless `causal`."""
    if causal:
        return solve_frames(frames, session, activity, progress, causal)
    solved = solve_frames(frames, session, activity, lambda share, text: progress(_LABELS_SHARE * share, text))

    def later(share: float) -> None:
        progress(_LABELS_SHARE + (1.0 - _LABELS_SHARE) * share, f"{activity} in both directions")

    return replace(solved, poses=tuple(session.solve_two_ways(solved.poses, later)))


def solve_frames(
    frames: Sequence[MarkerFrame],
    session: MultiTargetSession,
    activity: str,
    progress: Progress,
    causal: bool = False,
) -> SolvedTake:
    """Return the poses of frames, without motions.

    Labels that the session finds or replaces also hold before that moment, as far as they explain the markers better;
    if `causal`, from then on only, as live.
    """
    poses: list[ScenePose] = []
    seconds, begun = [], []
    for i, frame in enumerate(frames):
        if i % _REPORT_EVERY == 0:
            progress(_LIVE_SHARE * i / len(frames), activity)
        start, before = time.perf_counter(), session.labellings
        poses.append(session.step(frame))
        seconds.append(time.perf_counter() - start)
        if session.labellings != before:
            begun.append(i + 1)
    if causal:
        return SolvedTake(tuple(poses), (), np.array(seconds), np.zeros(len(poses), dtype=bool))

    def later(share: float) -> None:
        progress(_LIVE_SHARE + (1.0 - _LIVE_SHARE) * share, f"{activity} again")

    found, relabelled = relabel(frames, poses, [at for at in begun if at < len(frames)], session, later)
    return SolvedTake(tuple(found), (), np.array(seconds), relabelled)


def resample_uniform(poses: Sequence[PerformerPose], subject: Subject, name: str, where: str) -> Motion:
    """Return recorded poses as a motion of steady rate, with lost frames interpolated.

    Raises:
        TakeError: There are fewer than two poses, or their numbers do not ascend.
    """
    numbers = np.array([pose.number for pose in poses])
    if len(numbers) < 2 or np.any(np.diff(numbers) < 1):
        raise TakeError(f"has {len(numbers)} poses that make no motion", where=where, advice="record a longer take")
    fps = frame_rate(np.array([pose.time_s for pose in poses]), numbers)
    motion = motion_of(poses, subject, name, fps)
    wanted = np.arange(numbers[0], numbers[-1] + 1)
    if len(wanted) == len(numbers):
        return motion
    after = np.maximum(np.searchsorted(numbers, wanted), 1)
    before = after - 1
    share = ((wanted - numbers[before]) / (numbers[after] - numbers[before]))[:, None]
    rotations, positions = motion.rotations, motion.root_positions_m
    return replace(
        motion,
        rotations=rot.slerp(
            rotations[before], rotations[after], np.broadcast_to(share, (len(wanted), len(rotations[0])))
        ),
        root_positions_m=positions[before] + share * (positions[after] - positions[before]),
    )


def motion_of(poses: Sequence[PerformerPose], subject: Subject, name: str, fps: float) -> Motion:
    """Return poses of a steady rate as a motion of the subject's skeleton."""
    return Motion(
        name,
        fps,
        subject.skeleton,
        np.array([pose.rotations for pose in poses]),
        np.array([pose.root_position_m for pose in poses]),
    )
