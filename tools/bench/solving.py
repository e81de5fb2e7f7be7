"""Solving takes, and comparison of pose errors with the errors that the solver expects."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.body_parts import PART_JOINTS, PARTS
from perfanim.core.body.foot_lock import hold_feet
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.label_faults import correct_labels
from perfanim.core.markers.marker_set import PointKind, load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.markers.subject import Subject
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.delayed_poses import calm_poses
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import solve_frames, solve_take
from perfanim.core.session.solved_take import SolvedTake
from perfanim.core.session.steady_motion import motion_of
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress

from .scenarios import LIVE, OFFLINE

MARKER_SET = "boxing"
SKATE, DEEPEST = "skate_beyond_cm_s", "toes_below_mm"
_SHARE = 10  # the lowest and the highest tenth of the frames are compared


def true_subject(truth: Motion, points: PointKind = PointKind.MARKERS) -> Subject:
    """Return the subject with a motion's own skeleton and the benchmarks' markers, or keypoints at their places."""
    return Subject(truth.name, truth.skeleton, replace(load_marker_set(MARKER_SET), points=points))


def markers_of(motion: Motion) -> Array:
    """Return the true markers (F, M, 3) of a motion."""
    return simulate_markers(motion, true_subject(motion))[0].positions_m


def solve_truth(
    truth: Motion,
    database: Database,
    settings: SolveSettings,
    noise_mm: float = 0.0,
    dropout: float = 0.0,
    seed: int = 0,
) -> SolvedTake:
    """Solve a motion's labelled markers as in a live capture."""
    subject = true_subject(truth)
    take, _ = simulate_markers(truth, subject, noise_mm, dropout, seed)
    return solve_take(take, subject, database, settings, no_progress, causal=True)


def degrees_per_joint(motion: Motion, truth: Motion) -> Array:
    """Return the mean angle (F,) between local rotations, without the root, degrees."""
    between = rot.angle_between(motion.rotations[:, 1:], truth.rotations[:, 1:])
    return np.asarray(np.degrees(between.mean(axis=1)))


def describe(database: Database) -> dict[str, Any]:
    """Return the size of a database."""
    return {"frames": database.frames, "fps": database.fps, "clips": len(database.clips)}


class Way(NamedTuple):
    """A take solved in one mode, live or offline."""

    motion: Motion
    poses: list[PerformerPose]


def solve_both_ways(take: MarkerTake, subject: Subject, database: Database, settings: SolveSettings) -> dict[str, Way]:
    """Return a labelled take solved live and offline, as a capture and `solve` do.

    Offline, wrong labels and wild points are found first. Without any, it begins with the live poses.
    """
    session = MultiTargetSession([Session(subject, database, None, settings)])

    def solved(part: MarkerTake) -> SolvedTake:
        session.reset()
        return solve_frames(list(take_frames(part, subject.marker_set)), session, "", no_progress, causal=True)

    live = first = solved(take)
    corrected, faults = correct_labels(take, subject)
    if faults:
        first = solved(corrected)
    offline = session.solve_two_ways(first.poses, lambda share: None)
    calm = calm_poses(live.poses, noise_of(subject.marker_set.points))
    columns = {LIVE: [pose.performers[0] for pose in calm], OFFLINE: [pose.performers[0] for pose in offline]}
    return {way: Way(motion_of(poses, subject, take.name, take.fps), poses) for way, poses in columns.items()}


def first_pose(poses: Sequence[PerformerPose]) -> int:
    """Return the frame of the first pose that was solved; 0 if there is none."""
    return next((frame for frame, pose in enumerate(poses) if np.isfinite(pose.marker_rms_m)), 0)


def feet_errors(motion: Motion, truth: Motion, lasting_m: float = 0.0) -> dict[str, float]:
    """Return how feet skate and sink if they are held as in a capture.

    Args:
        lasting_m: As for `hold_feet`.

    Returns:
        skate_beyond_cm_s: mean horizontal speed of the toes while the true ones are planted, minus the truth's own; NaN
        if they never are. toes_below_mm: how far the toes' joint or tip goes below the true ones' lowest position.
    """
    held = hold_feet(motion, "auto", None, lasting_m)
    errors = evaluate(held, truth)
    below_m = float(np.min(_toe_heights(truth)) - np.min(_toe_heights(held)))
    return {
        SKATE: round(errors["foot_skate_cm_s"] - errors["foot_skate_truth_cm_s"], 4),
        DEEPEST: round(max(1e3 * below_m, 0.0), 2),
    }


def _toe_heights(motion: Motion) -> Array:
    """Return (F, 4) heights of the toes' joints and tips, metres."""
    skeleton = motion.skeleton
    positions, turns = forward_kinematics(skeleton, motion.rotations, motion.root_positions_m)
    toes = [skeleton.index(side + "toes") for side in "lr"]
    tips = positions[:, toes] + rot.rotate(turns[:, toes], skeleton.tips_m[toes])
    return np.concatenate((positions[:, toes, 1], tips[..., 1]), axis=1)


class Expected(NamedTuple):
    """Errors of a solved take and the errors that the solver expected."""

    confidence: Array  # (F,)
    joints_deg: Array  # (F, J - 1) errors of the joints except the root, degrees
    parts: Array  # (F, P) errors of the body's parts relative to the expected ones, NaN where nothing was expected
    joints: Array  # (F, J - 1) the same for joints


def expected_of(poses: Sequence[PerformerPose], truth: Motion) -> Expected:
    """Compare poses with their truth, frame by frame."""
    turns = np.array([pose.rotations for pose in poses])
    off_deg = np.degrees(rot.angle_between(turns, truth.rotations))
    parts_deg = np.stack([off_deg[:, joints].mean(axis=1) for joints in PART_JOINTS.values()], axis=1)
    return Expected(
        np.array([pose.confidence for pose in poses]),
        off_deg[:, 1:],
        parts_deg / _filled([pose.part_errors_deg for pose in poses], len(PARTS)),
        off_deg[:, 1:] / _filled([pose.joint_errors_deg for pose in poses], off_deg.shape[1] - 1),
    )


def _filled(errors_deg: Sequence[Array], count: int) -> Array:
    """Return expected errors (F, count), NaN in frames without any."""
    return np.array([row if len(row) else np.full(count, np.nan) for row in errors_deg])


def coverage(cases: Sequence[Expected], names: Sequence[str]) -> dict[str, Any]:
    """Return the shares of errors within twice the expected error, the 95 % intervals.

    Returns:
        frames, parts, joints, by_part and by_joint (the share for each name).
    """
    parts, joints = (np.concatenate([getattr(case, name) for case in cases]) for name in ("parts", "joints"))
    shares: dict[str, Any] = {"frames": len(parts), "parts": share_within(parts), "joints": share_within(joints)}
    for kind, columns, of in (("by_part", parts, PARTS), ("by_joint", joints, names)):
        shares[kind] = {name: share_within(column) for name, column in zip(of, columns.T, strict=True)}
    return shares


def share_within(ratios: Array) -> float:
    """Return the share of known errors within twice the expected ones."""
    known = ratios[np.isfinite(ratios)]
    return round(float(np.mean(known <= 2.0)), 4) if len(known) else float("nan")


def confidence_ratio(cases: Sequence[Expected]) -> dict[str, float]:
    """Return the mean errors in the tenths with lowest and highest confidence, and their ratio."""
    confidence = np.concatenate([case.confidence for case in cases])
    error = np.concatenate([case.joints_deg.mean(axis=1) for case in cases])
    order = np.argsort(confidence, kind="stable")
    tenth = max(len(order) // _SHARE, 1)
    lowest, highest = (float(error[frames].mean()) for frames in (order[:tenth], order[-tenth:]))
    return {
        "lowest_tenth_deg": round(lowest, 4),
        "highest_tenth_deg": round(highest, 4),
        "ratio": round(lowest / max(highest, 1e-6), 4),
    }
