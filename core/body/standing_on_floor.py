"""Standing feet of a motion put exactly on the floor.

Standing feet of a recorded motion are one or two centimetres above or below the floor, because soles are soft and
skeletons are not exact. The sole of a standing foot is brought to the floor: the hips follow the slow part of the
correction, and the legs bend for the rest. A lower foot that is hardly above the floor is on it, too, however fast it
is: it rolls off, or runs on a treadmill.
"""

from dataclasses import replace

import numpy as np

from ..geometry.arrays import Array, Mask
from .motion import Motion
from .moved_feet import eased_around, floor_height_m, sole_heights, with_moved_feet
from .standing_feet import planted_feet
from .window_filters import gaussian

_TOUCHES_M = 0.025  # height of the lower sole up to which it is on the floor
_FEET_S = 0.012  # standard deviation in time of the smoothing of the feet's correction
_HIPS_S = 0.1  # standard deviation in time of the smoothing of the hips' correction


def on_floor(motion: Motion, floor_m: float | None = None) -> Motion:
    """Return a motion whose floor is at y = 0, with standing feet exactly on it and no foot below it.

    Args:
        floor_m: Height of the motion's floor; None to estimate it.
    """
    floor_m = floor_height_m(motion) if floor_m is None else floor_m
    moved = replace(motion, root_positions_m=motion.root_positions_m - [0.0, floor_m, 0.0])
    heights = sole_heights(moved)
    lower = heights == heights.min(axis=1, keepdims=True)
    planted = planted_feet(moved, 0.0) | lower & (np.abs(heights) < _TOUCHES_M)
    raised = np.stack([eased_around(-heights[:, foot], planted[:, foot], motion.fps) for foot in range(2)], axis=1)
    raised = gaussian(np.maximum(raised, -heights), _FEET_S * motion.fps)
    hips = gaussian(_supported(raised, planted), _HIPS_S * motion.fps)[:, None]
    up = np.array([0.0, 1.0, 0.0])
    lifted = replace(moved, root_positions_m=moved.root_positions_m + hips * up)
    return with_moved_feet(lifted, (raised - hips)[..., None] * up)


def _supported(raised: Array, planted: Mask) -> Array:
    """Return the mean correction (F,) of the standing feet, interpolated where none stands."""
    count = planted.sum(axis=1)
    known = np.flatnonzero(count)
    if len(known) == 0:
        return np.zeros(len(raised))
    return np.interp(np.arange(len(raised)), known, (raised * planted).sum(axis=1)[known] / count[known])
