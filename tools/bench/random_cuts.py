"""Cuts from one take to another, without labels: when the labels are right again."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.scene_pose import DOUBTFUL, PerformerPose
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, Mask
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import solve_frames
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings

from .data import FPS
from .figure6 import true_subject

BEFORE, AFTER = 45, 75  # frames of a cut's two takes

_UNSOLVABLE = ("49_21",)  # hangs on ropes, which nobody does in the database
_T_POSE_EVERY = 3  # cuts, of which one comes from a T pose
_GHOST_SPREAD_M = 0.7
_RIGHT_M = 0.02  # a located marker is right so near its true place
_STEADY = 10  # frames on end that must be right


class Absence(NamedTuple):
    """Frames hidden between takes; how far, at most, the second is turned and moved."""

    hidden: tuple[int, ...] = (0, 12, 30, 60, 300)
    turn_rad: float = 1.2
    shift_m: float = 0.5


ANY = Absence()
LONG = Absence((120, 180, 240, 300), 1.5, 1.0)


class Disturbance(NamedTuple):
    """Noise, metres; share of lost markers; share of frames with up to so many ghosts."""

    noise_m: float = 0.002
    lost: float = 0.03
    ghost_frames: float = 0.1
    ghosts: int = 1


USUAL = Disturbance()


@dataclass(frozen=True)
class Cut:
    """Markers of one take, then none, then those of another take on the same body.

    Args:
        before, after: names of the takes; "T pose" stands for the pose on the body of the first.
        subject: name of the take that gives the body.
        hidden: frames without markers between the takes.
        positions_m: (F, M, 3) true places, NaN while hidden.
    """

    before: str
    after: str
    subject: str
    hidden: int
    skeleton: Skeleton
    positions_m: Array

    @property
    def title(self) -> str:
        """Name in tables."""
        return f"{self.before} > {self.after}"

    @property
    def back(self) -> int:
        """First frame of the second take."""
        return BEFORE + self.hidden


def random_cuts(
    takes: Mapping[str, Motion], count: int, generator: np.random.Generator, absence: Absence = ANY
) -> Iterator[Cut]:
    """Yield cuts between any two takes; the body is always that of the first."""
    pools = [
        [name for name, take in takes.items() if take.frames >= frames and name not in _UNSOLVABLE]
        for frames in (BEFORE, AFTER)
    ]
    for number in range(count):
        first = str(generator.choice(pools[0]))
        second = str(generator.choice([name for name in pools[1] if name != first]))
        skeleton, hidden = takes[first].skeleton, int(generator.choice(absence.hidden))
        before, after = (part_of(takes[name], frames, generator) for name, frames in ((first, BEFORE), (second, AFTER)))
        is_t_pose = number % _T_POSE_EVERY == 0
        if is_t_pose:
            before = replace(before, rotations=np.repeat(t_pose(skeleton)[None], BEFORE, axis=0))
        turn = generator.uniform(-absence.turn_rad, absence.turn_rad)
        x, z = generator.uniform(-absence.shift_m, absence.shift_m, 2)
        after = facing(replace(after, skeleton=skeleton), float(turn), np.array([x, 0.0, z]))
        seen = [markers_of(motion) for motion in (facing(before, 0.0, np.zeros(3)), after)]
        gone = np.full((hidden, *seen[0].shape[1:]), np.nan)
        title = "T pose" if is_t_pose else first
        yield Cut(title, second, first, hidden, skeleton, np.concatenate((seen[0], gone, seen[1])))


def facing(motion: Motion, yaw_rad: float, place_m: Array) -> Motion:
    """Return the motion moved to `place_m` and turned to face `yaw_rad` off +z."""
    forward = rot.rotate(motion.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
    turn = rot.from_rotation_vector(np.array([0.0, yaw_rad - np.arctan2(forward[0], forward[2]), 0.0]))
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, rotations[:, 0])
    from_start = motion.root_positions_m - motion.root_positions_m[0] * np.array([1.0, 0.0, 1.0])
    return replace(motion, rotations=rotations, root_positions_m=rot.rotate(turn, from_start) + place_m)


def play_cut(
    cut: Cut,
    database: Database,
    settings: SolveSettings,
    generator: np.random.Generator,
    disturbance: Disturbance = USUAL,
) -> tuple[dict[str, Any], Mask, Array]:
    """Show a cut's markers without labels to a session, live and as a recorded take.

    Returns:
        row of the table; (N,) frames of the second take with right labels live, and their confidences.
    """
    motion = Motion(cut.subject, FPS, cut.skeleton, t_pose(cut.skeleton)[None], np.zeros((1, 3)))
    session = MultiTargetSession([Session(true_subject(motion), database, settings=settings)])
    frames, shown = zip(
        *(frame_of(number, true, generator, disturbance) for number, true in enumerate(cut.positions_m)), strict=True
    )
    live = solve_frames(frames, session, cut.title, lambda fraction, text: None, causal=True).poses_of()
    session.reset()
    recorded = solve_frames(frames, session, cut.title, lambda fraction, text: None).poses_of()
    right = [_is_right(pose.observed_m, *seen) for pose, *seen in zip(live, cut.positions_m, shown, strict=True)]
    after, sure = np.array(right[cut.back :]), np.array([pose.confidence for pose in live[cut.back :]])
    steady = [i for i in range(len(after) - _STEADY + 1) if after[i : i + _STEADY].all()]
    wrong = ~after
    row = {
        "cut": cut.title,
        "body": cut.subject,
        "hidden_s": round(cut.hidden / FPS, 3),
        "right_again_s": round(steady[0] / FPS, 4) if steady else None,
        "wrong_frames": int(wrong.sum()),
        "doubted_wrong_frames": int((sure[wrong] < DOUBTFUL).sum()),
        "frames": len(after),
        "shown_markers": int(np.sum(shown)),
        "right_markers": _right_markers(live, cut, shown),
        "recorded_right_markers": _right_markers(recorded, cut, shown),
    }
    return row, after, sure


def _right_markers(poses: list[PerformerPose], cut: Cut, shown: Sequence[Mask]) -> int:
    """Return how many shown markers of all frames have their label."""
    away = np.linalg.norm([pose.observed_m for pose in poses] - cut.positions_m, axis=2)
    return int(np.sum((away < _RIGHT_M) & np.array(shown)))


def cut_figures(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures of all cuts.

    Labels that never come right count with the whole second take.
    """
    times = seconds_until_right(rows)
    wrong = sum(row["wrong_frames"] for row in rows)
    shown = sum(row["shown_markers"] for row in rows)
    doubted = sum(row["doubted_wrong_frames"] for row in rows)
    return {
        "right_again_s_median": round(float(np.median(times)), 4),
        "right_again_s_p95": round(float(np.percentile(times, 95)), 4),
        "right_again_s_max": round(float(times.max()), 4),
        "never_right": sum(row["right_again_s"] is None for row in rows),
        "wrong_share": round(wrong / sum(row["frames"] for row in rows), 4),
        "doubted_share_of_wrong": round(doubted / wrong, 4) if wrong else 1.0,
        "live_right_share": round(sum(row["right_markers"] for row in rows) / shown, 4),
        "recorded_right_share": round(sum(row["recorded_right_markers"] for row in rows) / shown, 4),
        "recorded_wrong_max": max(row["shown_markers"] - row["recorded_right_markers"] for row in rows),
    }


def seconds_until_right(rows: list[dict[str, Any]]) -> Array:
    """Return (N,) ascending times until the labels are right again."""
    times = [AFTER / FPS if row["right_again_s"] is None else row["right_again_s"] for row in rows]
    return np.sort(np.array(times, dtype=np.float64))


def part_of(motion: Motion, frames: int, generator: np.random.Generator) -> Motion:
    """Return so many frames from anywhere in a motion."""
    start = int(generator.integers(0, motion.frames - frames + 1))
    return sliced(motion, start, start + frames)


def markers_of(motion: Motion) -> Array:
    """Return the true markers (F, M, 3) of a motion."""
    return simulate_markers(motion, true_subject(motion))[0].positions_m


def frame_of(
    number: int, true: Array, generator: np.random.Generator, disturbance: Disturbance = USUAL
) -> tuple[MarkerFrame, Mask]:
    """Return a frame of points in any order, and the markers (M,) among them."""
    noise_m = disturbance.noise_m
    visible = np.isfinite(true[:, 0])
    shown = visible & (generator.random(len(true)) >= disturbance.lost)
    points = generator.permutation(true[shown] + generator.normal(0.0, noise_m, (int(shown.sum()), 3)))
    if generator.random() < disturbance.ghost_frames:
        centre = true[visible].mean(axis=0) if visible.any() else np.array([0.0, 1.0, 0.0])
        ghosts = 1 if disturbance.ghosts == 1 else int(generator.integers(1, disturbance.ghosts + 1))
        points = np.vstack((points, centre + generator.normal(0.0, _GHOST_SPREAD_M, (ghosts, 3))))
    covariances = np.broadcast_to(noise_m**2 * np.eye(3), (len(points), 3, 3))
    return MarkerFrame(number, number / FPS, points, covariances), shown


def _is_right(located: Array, true: Array, shown: Mask) -> bool:
    """Return whether labels are right.

    Every located marker is at its true place, and at most one of those shown is not located.
    """
    named = np.isfinite(located[:, 0])
    visible = np.isfinite(true[:, 0])
    if (named & ~visible).any() or int((shown & ~named).sum()) > 1:
        return False
    return bool(np.all(np.linalg.norm(located - true, axis=1)[named] < _RIGHT_M))
