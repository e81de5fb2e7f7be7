"""Feet as the default settings show them: held, beside those of the truth."""

import numpy as np
from perfanim.core.body.foot_lock import hold_feet
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array

HELD = "auto"  # as a capture has them


def feet_errors(motion: Motion, truth: Motion) -> dict[str, float]:
    """Return how held feet skate and sink.

    Returns:
        skate_beyond_cm_s: mean horizontal speed of the toes while the true ones stand, less the truth's own; NaN when
        they never do. toes_below_mm: how far the toes' joint or tip comes below the lowest place of the true ones.
    """
    held = hold_feet(motion, HELD, None)
    errors = evaluate(held, truth)
    below_m = float(np.min(_toes(truth)) - np.min(_toes(held)))
    return {
        "skate_beyond_cm_s": round(errors["foot_skate_cm_s"] - errors["foot_skate_truth_cm_s"], 4),
        "toes_below_mm": round(max(1e3 * below_m, 0.0), 2),
    }


def _toes(motion: Motion) -> Array:
    """Return (F, 4) heights of the toes' joints and tips, metres."""
    skeleton = motion.skeleton
    positions, turns = forward_kinematics(skeleton, motion.rotations, motion.root_positions_m)
    toes = [skeleton.index(side + "toes") for side in "lr"]
    tips = positions[:, toes] + rot.rotate(turns[:, toes], skeleton.tips_m[toes])
    return np.concatenate((positions[:, toes, 1], tips[..., 1]), axis=1)
