"""Takes solved by the default method and by `nearest`, with noise or without."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from perfanim.core.body.body_parts import PART_JOINTS
from perfanim.core.body.motion import Motion
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import motion_of, solve_frames, solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress

from .figure6 import true_subject

LIVE, OFFLINE = "live", "offline"
_NEAREST = SolveSettings(method="nearest")


@dataclass(frozen=True)
class Solved:
    """A take solved by the default method and by `nearest`.

    Args:
        rms_m, nearest_rms_m: (F,) distances between located and solved markers.
        expected_deg: (F, P) expected errors of the body's parts, NaN before the first pose.
    """

    motion: Motion
    nearest: Motion
    rms_m: Array
    nearest_rms_m: Array
    expected_deg: Array


def solve(
    truth: Motion,
    database: Database,
    settings: SolveSettings,
    noise_mm: float = 0.0,
    dropout: float = 0.0,
    seed: int = 0,
) -> tuple[Motion, list[PerformerPose]]:
    """Return the motion and the poses of a take's markers, solved."""
    subject = true_subject(truth)
    take, _ = simulate_markers(truth, subject, noise_mm, dropout, seed)
    result = solve_take(take, subject, database, settings, lambda fraction, text: None, causal=True)
    return result.motion, result.poses_of()


@dataclass(frozen=True)
class Way:
    """A take as it was solved one way."""

    motion: Motion
    poses: list[PerformerPose]


def solve_both_ways(take: MarkerTake, subject: Subject, database: Database, settings: SolveSettings) -> dict[str, Way]:
    """Return a labelled take as solved live and offline, as `solve_take` does each.

    In one go, as offline begins with the live poses: labels that are known do not change.
    """
    session = MultiTargetSession([Session(subject, database, None, settings)])
    live = solve_frames(list(take_frames(take, subject.marker_set)), session, "", no_progress, causal=True)
    offline = session.solve_two_ways(live.poses, lambda share: None)
    columns = {LIVE: live.poses_of(), OFFLINE: [pose.performers[0] for pose in offline]}
    return {way: Way(motion_of(poses, subject, take.name, take.fps), poses) for way, poses in columns.items()}


def first_pose(poses: Sequence[PerformerPose]) -> int:
    """Return the frame of the first pose that was solved; 0 if none was."""
    return next((frame for frame, pose in enumerate(poses) if np.isfinite(pose.marker_rms_m)), 0)


def solve_twice(
    truth: Motion,
    database: Database,
    settings: SolveSettings,
    noise_mm: float = 0.0,
    dropout: float = 0.0,
    seed: int = 0,
) -> Solved:
    """Solve a take's markers by the settings and by `nearest`."""
    (motion, poses), (nearest, nearest_poses) = (
        solve(truth, database, each, noise_mm, dropout, seed) for each in (settings, _NEAREST)
    )
    rms, nearest_rms = (np.array([pose.marker_rms_m for pose in found]) for found in (poses, nearest_poses))
    expected = [pose.part_errors_deg if len(pose.part_errors_deg) else [np.nan] * len(PART_JOINTS) for pose in poses]
    return Solved(motion, nearest, rms, nearest_rms, np.array(expected))


def part_errors(solved: Solved, truth: Motion) -> Array:
    """Return the errors (F, P) of the body's parts, means over their joints, degrees."""
    off_deg = np.degrees(rot.angle_between(solved.motion.rotations, truth.rotations))
    return np.stack([off_deg[:, joints].mean(axis=1) for joints in PART_JOINTS.values()], axis=1)
