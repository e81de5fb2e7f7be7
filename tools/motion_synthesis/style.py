"""Manner of moving: a few numbers that every behaviour of the performer reads."""

from dataclasses import dataclass, fields

import numpy as np
from perfanim.core.errors import SettingsError


@dataclass(frozen=True)
class Style:
    """Manner of moving; 1 is ordinary where a value is a factor.

    Args:
        name: as listed.
        tempo: cycles and strikes per time, factor.
        amplitude: reach of strides, strikes and jumps, factor.
        arm_swing: factor on the arms' swing in gait.
        bounce: factor on how much knees give.
        slouch_rad: forward bend of the trunk, radians; negative is chest out.
        head_drop_rad: the head's lowering, radians.
        width: factor on the stance's and steps' width.
        asymmetry: difference between sides, share (0.1: ten per cent).
        variation: scatter from repetition to repetition, factor.
        elbows_rad: extra bend of hanging arms, radians.
        toe_out_rad: outward turn of the feet, radians.
    """

    name: str = "neutral"
    tempo: float = 1.0
    amplitude: float = 1.0
    arm_swing: float = 1.0
    bounce: float = 1.0
    slouch_rad: float = 0.03
    head_drop_rad: float = 0.0
    width: float = 1.0
    asymmetry: float = 0.03
    variation: float = 1.0
    elbows_rad: float = 0.0
    toe_out_rad: float = 0.12

    def __post_init__(self) -> None:
        for name in ("tempo", "amplitude", "bounce", "width"):
            value = getattr(self, name)
            if not 0.3 <= value <= 2.0:
                raise SettingsError(f"style {self.name!r}: {name} {value} is outside 0.3..2")
        numbers = [getattr(self, f.name) for f in fields(self) if f.name != "name"]
        if not np.all(np.isfinite(numbers)):
            raise SettingsError(f"style {self.name!r} holds a number that is not finite")


STYLES: dict[str, Style] = {
    style.name: style
    for style in (
        Style(),
        Style("energetic", 1.12, 1.15, 1.35, 1.15, -0.02, -0.05, 1.0, 0.02, 1.1, 0.15, 0.10),
        Style("relaxed", 0.90, 0.92, 0.90, 0.95, 0.05, 0.03, 1.1, 0.05, 1.2, 0.02, 0.18),
        Style("tired", 0.80, 0.80, 0.55, 0.85, 0.20, 0.20, 1.15, 0.08, 1.2, -0.05, 0.16),
        Style("proud", 0.95, 1.05, 1.10, 1.00, -0.06, -0.08, 1.0, 0.03, 0.8, 0.05, 0.20),
        Style("careful", 0.78, 0.75, 0.50, 1.10, 0.12, 0.12, 1.35, 0.05, 1.0, 0.35, 0.14),
        Style("brisk", 1.18, 1.02, 1.10, 0.90, 0.06, 0.00, 0.9, 0.03, 0.8, 0.25, 0.08),
        Style("loose", 0.95, 1.05, 1.40, 1.25, 0.08, 0.02, 1.2, 0.07, 1.6, 0.10, 0.22),
    )
}


def style_named(name: str) -> Style:
    """Return a style by name; SettingsError lists the styles there are."""
    if name not in STYLES:
        raise SettingsError(f"there is no style {name!r}", advice="styles: " + ", ".join(STYLES))
    return STYLES[name]
