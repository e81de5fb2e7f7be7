"""Takes after a T pose, and with noise, by subjects that the database lacks."""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, runs
from perfanim.core.solver.settings import SolveSettings

from .data import FPS
from .figure6 import degrees_per_joint
from .random_cuts import BEFORE, Cut, Disturbance, facing, markers_of, play_cut
from .solved_takes import part_errors, solve, solve_twice
from .worst_frames import WorstFrames

JUMP_DEG = 10.0  # change of a joint between two frames beyond the truth's own
_T_POSE_S = 0.5  # before a take
_FIRST = 15  # frames after the T pose that are compared
_FAR_M = 0.03
_NOISE_MM, _DROPOUT = 3.0, 0.1
_WORSE, _WORSE_S = 1.2, 0.2  # share of nearest's error, and how long it may last
_GHOSTS = Disturbance(0.001 * _NOISE_MM, _DROPOUT, 1.0, 2)


class Curves(NamedTuple):
    """Errors (F,) of a part of a take, degrees per joint.

    Args:
        first: number of its first frame in the take.
    """

    first: int
    best: Array
    nearest: Array


class TakeFigures(NamedTuple):
    """Figures of a take after a T pose, and for each pass of its middle with noise."""

    t_pose: dict[str, Any]
    noise: list[dict[str, Any]]
    curves: dict[str, Curves]
    worst: WorstFrames


def take_figures(
    name: str, take: Motion, database: Path, settings: SolveSettings, frames: tuple[int, int], passes: int
) -> TakeFigures:
    """Solve a take after a T pose, and its middle with noise.

    Args:
        frames: after the T pose, and of the middle, at most.
    """
    opened, worst = open_database(database), WorstFrames([], [])
    t_pose_frames, noisy_frames = frames
    after = t_pose_row(name, sliced(take, 0, min(t_pose_frames, take.frames)), opened, settings, worst)
    start = max((take.frames - noisy_frames) // 2, 0)
    middle = sliced(take, start, min(start + noisy_frames, take.frames))
    noisy = [noisy_row(name, middle, start, opened, settings, seed, worst) for seed in range(passes)]
    curves = {f"{name}, noise {seed}": curve for seed, (_, curve) in enumerate(noisy)}
    return TakeFigures(after, [row for row, _ in noisy], curves, worst)


def t_pose_row(
    name: str, truth: Motion, database: Database, settings: SolveSettings, worst: WorstFrames
) -> dict[str, Any]:
    """Return how much a T pose before a take costs the frames after it."""
    cold = degrees_per_joint(solve(truth, database, settings)[0], truth)[:_FIRST].mean()
    both = with_t_pose(truth)
    lead = both.frames - truth.frames
    solved = solve_twice(both, database, settings)
    first = degrees_per_joint(solved.motion, both)[lead : lead + _FIRST]
    far = np.where(solved.rms_m > solved.nearest_rms_m, solved.rms_m, 0.0)[lead:]
    frame = int(np.argmax(first))
    worst.add("degrees per joint after a T pose", name, frame, "", first[frame])
    worst.add_picture(f"{name} after a T pose, frame {frame}", first[frame], both, solved.motion, lead + frame)
    worst.add("mm RMS after a T pose, nearest nearer", name, int(np.argmax(far)), "", 1e3 * far.max())
    return {
        "take": name,
        "frames": truth.frames,
        "deg_per_joint_without": round(float(cold), 4),
        "deg_per_joint_after": round(float(first.mean()), 4),
        "ratio": round(float(first.mean() / cold), 4),
        "frames_over_30_mm": int((far > _FAR_M).sum()),
    }


def noisy_row(
    name: str, truth: Motion, start: int, database: Database, settings: SolveSettings, seed: int, worst: WorstFrames
) -> tuple[dict[str, Any], Curves]:
    """Return figures of a part of a take with noise, and both errors by frame.

    Args:
        start: number of its first frame in the take.
    """
    solved = solve_twice(truth, database, settings, _NOISE_MM, _DROPOUT, seed)
    error, nearest = (degrees_per_joint(motion, truth) for motion in (solved.motion, solved.nearest))
    further = np.nan_to_num(solved.rms_m - solved.nearest_rms_m)
    known = np.isfinite(solved.expected_deg)
    within = (part_errors(solved, truth) <= 2.0 * solved.expected_deg)[known]
    jumps = _changes_deg(solved.motion) - _changes_deg(truth)
    jumped = (jumps > JUMP_DEG).any(axis=1)
    over = error / np.maximum(nearest, 1e-6)
    late = round(_WORSE_S * FPS)
    too_long = sum(max(stop - begin - late, 0) for begin, stop in runs(over > _WORSE))
    frame, joint = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
    for check, at, where, value in (
        ("joint change beyond the truth's, deg", frame + 1, truth.skeleton.names[joint + 1], jumps[frame, joint]),
        ("markers further off than nearest's, mm", np.argmax(further), "", 1e3 * further.max()),
        ("error as a share of nearest's", np.argmax(over), "", over.max()),
        ("degrees per joint with noise", np.argmax(error), "", error.max()),
    ):
        worst.add(check, f"{name} (noise {seed})", start + int(at), where, value)
    most = int(np.argmax(error))
    worst.add_picture(f"{name} with noise, frame {start + most}", error[most], truth, solved.motion, most)
    whole = Cut(name, name, name, -BEFORE, truth.skeleton, markers_of(truth))  # one take, from its first frame on
    ghostly, _, _ = play_cut(whole, database, settings, np.random.default_rng(seed), _GHOSTS)
    row = {
        "take": name,
        "seed": seed,
        "first_frame": start,
        "frames": truth.frames,
        "deg_per_joint": round(float(error.mean()), 4),
        "nearest_deg_per_joint": round(float(nearest.mean()), 4),
        "worse_explained_frames": int((further > 0.0).sum()),
        "jump_frames": int(jumped.sum()),
        "first_jumps": int((jumped & ~known[:-1].any(axis=1)).sum()),
        "long_worse_frames": too_long,
        "ghost_shown_markers": ghostly["shown_markers"],
        "ghost_right_markers": ghostly["right_markers"],
        "ghost_wrong_frames": ghostly["wrong_frames"],
        "ghost_doubted_wrong_frames": ghostly["doubted_wrong_frames"],
        "part_errors_within_twice_expected": round(float(within.mean()), 4),
    }
    return row, Curves(start, error, nearest)


def with_t_pose(motion: Motion) -> Motion:
    """Return the motion with a T pose held before it.

    The pose stands where the motion begins and faces the same way; a cut is between them.
    """
    pose = t_pose(motion.skeleton)[None]
    still = replace(motion, rotations=pose, root_positions_m=motion.root_positions_m[:1])
    forward = rot.rotate(motion.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
    below = motion.root_positions_m[0] * np.array([1.0, 0.0, 1.0])
    still = facing(still, float(np.arctan2(forward[0], forward[2])), below)
    frames = round(_T_POSE_S * motion.fps)
    return replace(
        motion,
        rotations=np.concatenate((np.repeat(still.rotations, frames, axis=0), motion.rotations)),
        root_positions_m=np.concatenate((np.repeat(still.root_positions_m, frames, axis=0), motion.root_positions_m)),
    )


def _changes_deg(motion: Motion) -> Array:
    """Return (F - 1, J - 1) turns of the joints but the root between two frames."""
    return np.asarray(np.degrees(rot.angle_between(motion.rotations[:-1, 1:], motion.rotations[1:, 1:])))
