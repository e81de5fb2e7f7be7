"""Manner of moving: a few numbers that all behaviours of the performer use."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Style:
    """Manner of moving; factors are 1 for ordinary movement."""

    name: str = "neutral"
    tempo: float = 1.0  # factor for cycles and strikes per time
    amplitude: float = 1.0  # factor for the reach of strides, strikes and jumps
    arm_swing: float = 1.0  # factor for the arm swing in gait
    bounce: float = 1.0  # factor for how much the knees give
    slouch_rad: float = 0.03  # forward bend of the trunk; negative is chest out
    head_drop_rad: float = 0.0  # downward pitch of the head
    width: float = 1.0  # factor for the width of stance and steps
    asymmetry: float = 0.03  # difference between left and right, as a share
    variation: float = 1.0  # factor for the scatter between repetitions
    elbows_rad: float = 0.0  # additional bend of hanging arms
    toe_out_rad: float = 0.12  # outward turn of the feet


_STYLES = (
    Style(),
    Style("energetic", 1.12, 1.15, 1.35, 1.15, -0.02, -0.05, 1.0, 0.02, 1.1, 0.15, 0.10),
    Style("relaxed", 0.90, 0.92, 0.90, 0.95, 0.05, 0.03, 1.1, 0.05, 1.2, 0.02, 0.18),
    Style("tired", 0.80, 0.80, 0.55, 0.85, 0.20, 0.20, 1.15, 0.08, 1.2, -0.05, 0.16),
    Style("proud", 0.95, 1.05, 1.10, 1.00, -0.06, -0.08, 1.0, 0.03, 0.8, 0.05, 0.20),
    Style("brisk", 1.18, 1.02, 1.10, 0.90, 0.06, 0.00, 0.9, 0.03, 0.8, 0.25, 0.08),
    Style("loose", 0.95, 1.05, 1.40, 1.25, 0.08, 0.02, 1.2, 0.07, 1.6, 0.10, 0.22),
)
STYLES = {style.name: style for style in _STYLES}
