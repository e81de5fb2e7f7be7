"""Expected errors, and confidence, beside the errors that poses have."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from perfanim.core.body.body_parts import PART_JOINTS, PARTS
from perfanim.core.body.motion import Motion
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array

_SHARE = 10  # the lowest and the highest tenth of the frames are compared


@dataclass(frozen=True)
class Expected:
    """Errors of a solved take beside those that the solver expected.

    Args:
        confidence: (F,).
        joints_deg: (F, J - 1) errors of the joints but the root, degrees.
        parts: (F, P) errors of the body's parts as shares of the expected ones, NaN where nothing was expected.
        joints: (F, J - 1) the same of joints.
    """

    confidence: Array
    joints_deg: Array
    parts: Array
    joints: Array


def expected_of(poses: Sequence[PerformerPose], truth: Motion) -> Expected:
    """Compare poses with their truth, frame by frame."""
    turns = np.array([pose.rotations for pose in poses])
    off_deg = np.degrees(rot.angle_between(turns, truth.rotations))
    parts_deg = np.stack([off_deg[:, joints].mean(axis=1) for joints in PART_JOINTS.values()], axis=1)
    return Expected(
        np.array([pose.confidence for pose in poses]),
        off_deg[:, 1:],
        parts_deg / _rows([pose.part_errors_deg for pose in poses], len(PARTS)),
        off_deg[:, 1:] / _rows([pose.joint_errors_deg for pose in poses], off_deg.shape[1] - 1),
    )


def _rows(errors_deg: Sequence[Array], count: int) -> Array:
    """Return (F, count) expected errors, NaN in frames without any."""
    return np.array([row if len(row) else np.full(count, np.nan) for row in errors_deg])


def coverage(cases: Sequence[Expected], names: Sequence[str]) -> dict[str, Any]:
    """Return the shares of errors within twice the expected, the 95 % intervals.

    Returns:
        frames, parts, joints, and by_joint (the share of each name).
    """
    parts, joints = (np.concatenate([getattr(case, name) for case in cases]) for name in ("parts", "joints"))
    by_joint = {name: _held(column) for name, column in zip(names, joints.T, strict=True)}
    return {"frames": len(parts), "parts": _held(parts), "joints": _held(joints), "by_joint": by_joint}


def _held(ratios: Array) -> float:
    known = ratios[np.isfinite(ratios)]
    return round(float(np.mean(known <= 2.0)), 4) if len(known) else float("nan")


def confidence_ratio(cases: Sequence[Expected]) -> dict[str, float]:
    """Return the mean errors of the frames of lowest and of highest confidence.

    Of a tenth of all frames each, and their ratio.
    """
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
