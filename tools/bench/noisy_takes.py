"""Takes after a T pose, and with noise, by subjects who are not in the database; the worst frames."""

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

from .plots import Picture
from .scenarios import FPS
from .scenes import Cut, Faults, facing, play_cut
from .solving import degrees_per_joint, expected_of, markers_of, share_within, solve_truth

Row = dict[str, Any]
_LISTED, _DRAWN = 20, 24  # worst frames listed for each check, and drawn
_JUMP_DEG = 10.0  # smallest jump: change of a joint between two frames beyond the truth's
_T_POSE_S, _FIRST = 0.5, 15  # duration of the T pose before a take; number of frames after it that are compared
_FAR_M = 0.03
_NOISE_MM, _DROPOUT = 3.0, 0.1
_WORSE, _WORSE_S = 1.2, 0.2  # factor on the error of "nearest", and how long it may be exceeded
_GHOSTS = Faults(0.001 * _NOISE_MM, _DROPOUT, 1.0, 2)
_NEAREST = SolveSettings(method="nearest")


class Worst:
    """Values of single frames, and pictures of some of them with their errors."""

    def __init__(self) -> None:
        self.frames: list[Row] = []
        self.pictures: list[tuple[float, Picture]] = []

    def add(self, check: str, take: str, frame: Any, value: float, joint: str = "") -> None:
        """Add the value of a frame."""
        row = {"check": check, "take": take, "frame": int(frame), "joint": joint, "value": round(float(value), 4)}
        self.frames.append(row)

    def add_picture(self, title: str, error: float, truth: Motion, solved: Motion, frame: int) -> None:
        """Add a frame to be drawn, with its error in degrees per joint."""
        self.pictures.append((error, Picture.of(f"{title}: {error:.0f} deg", truth, solved, frame)))

    def extend(self, other: "Worst") -> None:
        """Add the frames and pictures of another list."""
        self.frames += other.frames
        self.pictures += other.pictures

    def listed(self) -> list[Row]:
        """Return the largest positive values for each check."""
        ordered = sorted((frame for frame in self.frames if frame["value"] > 0.0), key=lambda frame: -frame["value"])
        checks = dict.fromkeys(frame["check"] for frame in self.frames)
        return [frame for check in checks for frame in [f for f in ordered if f["check"] == check][:_LISTED]]

    def drawn(self) -> list[Picture]:
        """Return the worst pictures, worst first."""
        return [picture for _, picture in sorted(self.pictures, key=lambda pair: -pair[0])[:_DRAWN]]


class Curves(NamedTuple):
    """Errors (F,) in a part of a take, degrees per joint."""

    first: int  # number of its first frame in the take
    best: Array
    nearest: Array


def take_figures(
    name: str, take: Motion, database: Path, settings: SolveSettings, frames: tuple[int, int], passes: int
) -> tuple[Row, list[Row], dict[str, Curves], Worst]:
    """Solve a take after a T pose, and its middle with noise, using at most this many frames each."""
    opened, worst = open_database(database), Worst()
    after = _t_pose_row(name, sliced(take, 0, min(frames[0], take.frames)), opened, settings, worst)
    start = max((take.frames - frames[1]) // 2, 0)
    middle = sliced(take, start, min(start + frames[1], take.frames))
    noisy = [_noisy_row(name, middle, start, opened, settings, seed, worst) for seed in range(passes)]
    return after, [row for row, _ in noisy], {f"{name}, noise {i}": curve for i, (_, curve) in enumerate(noisy)}, worst


def _t_pose_row(name: str, truth: Motion, database: Database, settings: SolveSettings, worst: Worst) -> Row:
    """Return how much a T pose before a take worsens the frames after it."""
    cold = degrees_per_joint(solve_truth(truth, database, settings).motion, truth)[:_FIRST].mean()
    both = with_t_pose(truth)
    lead = both.frames - truth.frames
    solved, nearest = (solve_truth(both, database, each) for each in (settings, _NEAREST))
    first = degrees_per_joint(solved.motion, both)[lead : lead + _FIRST]
    rms_m, nearest_rms_m = (np.array([pose.marker_rms_m for pose in each.poses_of()]) for each in (solved, nearest))
    far = np.where(rms_m > nearest_rms_m, rms_m, 0.0)[lead:]
    frame = int(np.argmax(first))
    worst.add("degrees per joint after a T pose", name, frame, first[frame])
    worst.add_picture(f"{name} after a T pose, frame {frame}", first[frame], both, solved.motion, lead + frame)
    worst.add("mm RMS after a T pose, nearest nearer", name, int(np.argmax(far)), 1e3 * far.max())
    return {
        "take": name,
        "frames": truth.frames,
        "deg_per_joint_without": round(float(cold), 4),
        "deg_per_joint_after": round(float(first.mean()), 4),
        "ratio": round(float(first.mean() / cold), 4),
        "frames_over_30_mm": int((far > _FAR_M).sum()),
    }


def _noisy_row(
    name: str, truth: Motion, start: int, database: Database, settings: SolveSettings, seed: int, worst: Worst
) -> tuple[Row, Curves]:
    """Return figures for a part of a take with noise that begins at frame `start`, and both errors by frame."""
    solved, other = (solve_truth(truth, database, each, _NOISE_MM, _DROPOUT, seed) for each in (settings, _NEAREST))
    error, nearest = (degrees_per_joint(each.motion, truth) for each in (solved, other))
    rms_m, nearest_rms_m = (np.array([pose.marker_rms_m for pose in each.poses_of()]) for each in (solved, other))
    further = np.nan_to_num(rms_m - nearest_rms_m)
    parts = expected_of(solved.poses_of(), truth).parts
    jumps = _changes_deg(solved.motion) - _changes_deg(truth)
    jumped = (jumps > _JUMP_DEG).any(axis=1)
    over = error / np.maximum(nearest, 1e-6)
    late = round(_WORSE_S * FPS)
    frame, joint = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
    title = f"{name} (noise {seed})"
    joint_name = truth.skeleton.names[joint + 1]
    worst.add("joint change beyond the truth's, deg", title, start + frame + 1, jumps[frame, joint], joint_name)
    for check, values in (
        ("markers further off than nearest's, mm", 1e3 * further),
        ("error as a share of nearest's", over),
        ("degrees per joint with noise", error),
    ):
        worst.add(check, title, start + int(np.argmax(values)), values.max())
    most = int(np.argmax(error))
    worst.add_picture(f"{name} with noise, frame {start + most}", error[most], truth, solved.motion, most)
    whole = Cut(name, name, truth.skeleton, markers_of(truth))  # one take, from its first frame on
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
        "first_jumps": int((jumped & ~np.isfinite(parts)[:-1].any(axis=1)).sum()),
        "long_worse_frames": sum(max(stop - begin - late, 0) for begin, stop in runs(over > _WORSE)),
        "part_errors_within_twice_expected": share_within(parts),
    }
    ghost_keys = ("shown_markers", "right_markers", "wrong_frames", "doubted_wrong_frames")
    return row | {f"ghost_{key}": ghostly[key] for key in ghost_keys}, Curves(start, error, nearest)


def with_t_pose(motion: Motion) -> Motion:
    """Return the motion with a T pose held before it, at its start and facing the same way, followed by a cut."""
    forward = rot.rotate(motion.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
    first = motion.root_positions_m[:1]
    still = replace(motion, rotations=t_pose(motion.skeleton)[None], root_positions_m=first)
    still = facing(still, float(np.arctan2(forward[0], forward[2])), first[0] * np.array([1.0, 0.0, 1.0]))
    frames = round(_T_POSE_S * motion.fps)
    return replace(
        motion,
        rotations=np.concatenate((np.repeat(still.rotations, frames, axis=0), motion.rotations)),
        root_positions_m=np.concatenate((np.repeat(still.root_positions_m, frames, axis=0), motion.root_positions_m)),
    )


def _changes_deg(motion: Motion) -> Array:
    """Return the rotations (F - 1, J - 1) of the joints except the root between two frames."""
    return np.asarray(np.degrees(rot.angle_between(motion.rotations[:-1, 1:], motion.rotations[1:, 1:])))
