"""Quality of a solved take when the truth is unknown."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...body.motion import Motion
from ...body.scene_pose import PerformerPose
from ...body.skeleton import forward_kinematics
from ...geometry.arrays import Mask, runs
from ...session.verdict import is_unsolved

if TYPE_CHECKING:
    from ...session.solved_take import SolvedTake

_DIGITS = 4  # significant digits of figures in files: the last bits may differ between machines
_TOES = ("ltoes", "rtoes")
_FLOOR_PERCENTILE = 2.0  # percentile of a toe's height taken as the floor, because it may be too low in a few frames
_NEAR_FLOOR_M = 0.025


@dataclass(frozen=True)
class Limit:
    """Threshold above which a figure is doubtful, and a description."""

    figure: str
    most: float
    text: str


LIMITS = (
    Limit("marker_rms_mm", 30.0, "markers are {:.0f} mm off"),
    Limit("hidden", 0.2, "{:.0%} of the markers are hidden"),
    Limit("longest_gap_s", 1.0, "a marker is hidden for {:.1f} s"),
    Limit("foot_skate_cm_s", 50.0, "feet slide at {:.0f} cm/s"),
)
LEAST_CONFIDENCE = 0.5


def quality_figures(solved: "SolvedTake") -> dict[str, float | int | None]:
    """Return the figures of a solved take; unknown ones are None.

    Returns:
        Figures by name:

        - frames, fps, duration_s.
        - marker_rms_mm: RMS distance between located and solved markers; marker_median_mm: the median of the
          frames' RMS distances; marker_worst_mm: the largest.
        - confidence: mean over the frames; confidence_low: value that 95 % of the frames reach.
        - hidden: share of marker positions that no camera shows; longest_gap_s: longest time that a marker is hidden.
        - unsolved: share of the frames without a pose of their own.
    """
    poses, motion = solved.poses_of(), solved.motion
    rms = np.array([pose.marker_rms_m for pose in poses])
    rms_mm = 1e3 * rms[np.isfinite(rms)]
    confidence = np.array([pose.confidence for pose in poses])
    hidden = np.array([~np.isfinite(pose.observed_m[:, 0]) & (pose.single_cameras < 0) for pose in poses])
    figures = {
        "frames": len(poses),
        "fps": motion.fps,
        "duration_s": motion.duration_s,
        "marker_rms_mm": float(np.sqrt(np.mean(rms_mm**2))) if len(rms_mm) else float("nan"),
        "marker_median_mm": float(np.median(rms_mm)) if len(rms_mm) else float("nan"),
        "marker_worst_mm": float(rms_mm.max()) if len(rms_mm) else float("nan"),
        "confidence": float(np.mean(confidence)),
        "confidence_low": float(np.percentile(confidence, 5)),
        "hidden": float(np.mean(hidden)),
        "longest_gap_s": _longest_s(poses, hidden),
        "unsolved": float(np.mean(is_unsolved(poses))),
        "foot_skate_cm_s": foot_skate_cm_s(motion),
    }
    return {name: _round(value) for name, value in figures.items()}


def _longest_s(poses: Sequence[PerformerPose], hidden: Mask) -> float:
    """Return the longest time that a marker of a mask (F, M) is hidden, from the last visible frame to the next."""
    times_s = [pose.time_s for pose in poses]
    edges_s = [times_s[0], *times_s, times_s[-1]]
    return max((edges_s[stop + 1] - edges_s[start] for marker in hidden.T for start, stop in runs(marker)), default=0.0)


def foot_skate_cm_s(motion: Motion) -> float:
    """Return how fast the toes slide over the floor, cm/s.

    Each toe's floor is the second percentile of its height. At a height h of less than H = 2.5 cm above it, the toe's
    horizontal speed counts with the weight 2 - 2^(h / H), which is 1 on the floor and 0 at H (Zhang et al. 2018,
    Mode-Adaptive Neural Networks, section 8). NaN if no toe is ever that low.
    """
    toes = [motion.skeleton.names.index(name) for name in _TOES if name in motion.skeleton.names]
    if not toes or motion.frames < 2:
        return float("nan")
    positions = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0][:, toes]
    speed = np.linalg.norm(np.diff(positions, axis=0)[..., [0, 2]], axis=-1) * motion.fps
    height = positions[..., 1] - np.percentile(positions[..., 1], _FLOOR_PERCENTILE, axis=0)
    height = np.clip(0.5 * (height[1:] + height[:-1]), 0.0, _NEAR_FLOOR_M)
    near = height < _NEAR_FLOOR_M
    if not np.any(near):
        return float("nan")
    return 100.0 * float(np.mean((speed * (2.0 - 2.0 ** (height / _NEAR_FLOOR_M)))[near]))


def why_doubtful(figures: dict[str, float | int | None]) -> list[str]:
    """Return the reasons to look at a solved take, other than its verdict."""
    reasons = []
    for limit in LIMITS:
        value = figures[limit.figure]
        if value is not None and value > limit.most:
            reasons.append(limit.text.format(value))
    confidence = figures["confidence"]
    if confidence is not None and confidence < LEAST_CONFIDENCE:
        advice = "check performer and labels, or add motion like this to the database"
        reasons.append(f"confidence is {confidence:.0%}: {advice}")
    return reasons


def _round(value: float | int) -> float | int | None:
    if isinstance(value, int):
        return value
    return round(value, _DIGITS) if np.isfinite(value) else None
