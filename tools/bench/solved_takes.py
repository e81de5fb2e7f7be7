"""Takes solved by the default method and by `nearest`, with noise or without."""

from dataclasses import dataclass

import numpy as np
from perfanim.core.body.body_parts import PART_JOINTS
from perfanim.core.body.motion import Motion
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings

from .figure6 import true_subject

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
