"""Edits of a motion after its capture: trim, mirror, smooth, and remove a pop."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import SettingsError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from .mirroring import mirrored_points, mirrored_rotations
from .motion import Motion
from .moved_feet import smooth_step
from .seams import about_vertical, heading
from .skeleton import forward_kinematics
from .window_filters import gaussian


@dataclass(frozen=True)
class TPoseSettings:
    """A T pose held before a take."""

    level: float = 0.35  # largest rise of an arm against the horizontal, sine
    straight: float = 0.9  # smallest distance of the hands from the shoulders, as a fraction of the arm's length
    least_s: float = 0.3  # shortest time for which it is held
    after_s: float = 0.4  # time from its end until the arms are down


_T_POSE = TPoseSettings()


def t_pose_end(motion: Motion) -> int:
    """Return the frame at which the T pose before a take is over; 0 if the take does not begin with one."""
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    holds = np.ones(motion.frames, dtype=np.bool_)
    for side in "lr":
        shoulder, elbow, hand = (motion.skeleton.index(side + name) for name in ("humerus", "radius", "hand"))
        arm = positions[:, hand] - positions[:, shoulder]
        length = np.linalg.norm(arm, axis=1)
        bones = sum(
            np.linalg.norm(positions[:, b] - positions[:, a], axis=1) for a, b in ((shoulder, elbow), (elbow, hand))
        )
        holds &= (np.abs(arm[:, 1]) < _T_POSE.level * length) & (length > _T_POSE.straight * bones)
    end = motion.frames if holds.all() else int(np.argmin(holds))
    if end < _T_POSE.least_s * motion.fps:
        return 0
    return min(end + round(_T_POSE.after_s * motion.fps), motion.frames - 1)


def mirrored(motion: Motion) -> Motion:
    """Return the motion with left and right exchanged, from the same place and heading."""
    start_m = motion.root_positions_m[0] * [1.0, 0.0, 1.0]
    ahead = about_vertical(heading(motion.rotations[0, 0]))
    back = rot.conjugate(ahead)
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(back, rotations[:, 0])
    rotations = mirrored_rotations(rotations)
    rotations[:, 0] = rot.multiply(ahead, rotations[:, 0])
    roots_m = mirrored_points(rot.rotate(back, motion.root_positions_m - start_m))
    return replace(motion, rotations=rotations, root_positions_m=rot.rotate(ahead, roots_m) + start_m)


def smoothed(motion: Motion, first: int, last: int, smoothing_s: float) -> Motion:
    """Return the motion with the frames from `first` to `last` smoothed, eased in and out.

    Args:
        smoothing_s: Standard deviation in time of the Gaussian filter.

    Raises:
        SettingsError: The range has no frames.
    """
    _check(motion, first, last)
    sigma = smoothing_s * motion.fps
    at = np.arange(motion.frames)
    ease = max(sigma, 1.0)
    share = smooth_step(np.minimum(at - first + ease, last + ease - at) / ease)[:, None]
    flat = rot.continuous(motion.rotations).reshape(motion.frames, -1)
    turned = gaussian(flat, sigma).reshape(motion.rotations.shape)
    moved = gaussian(motion.root_positions_m, sigma)
    rotations = rot.slerp(motion.rotations, rot.normalize(turned), share)
    roots_m = motion.root_positions_m + share * (moved - motion.root_positions_m)
    return replace(motion, rotations=rotations, root_positions_m=roots_m)


def without_pop(motion: Motion, first: int, last: int) -> Motion:
    """Return the motion with the frames from `first` to `last` replaced by a smooth path between their neighbours.

    Raises:
        SettingsError: The range has no frames, or no two frames remain before and after it.
    """
    _check(motion, first, last)
    if first < 2 or last > motion.frames - 3:
        advice = "go to the pop, or choose a smaller range"
        raise SettingsError("needs two frames before and after the pop", advice=advice)
    known = np.array([first - 2, first - 1, last + 1, last + 2])
    gap = np.arange(first, last + 1)
    rotations, roots_m = motion.rotations.copy(), motion.root_positions_m.copy()
    rotations[gap] = rot.normalize(_cubic(known, rot.continuous(motion.rotations[known]), gap))
    roots_m[gap] = _cubic(known, motion.root_positions_m[known], gap)
    return replace(motion, rotations=rotations, root_positions_m=roots_m)


def _cubic(known: IntArray, values: Array, wanted: IntArray) -> Array:
    """Return values between the middle two of four frames, with the speeds of the outer pairs (cubic Hermite)."""
    length = float(known[2] - known[1])
    s = ((wanted - known[1]) / length).reshape(-1, *(1,) * (values.ndim - 1))
    before, after = (values[1] - values[0]) * length, (values[3] - values[2]) * length
    ends = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * values[1] + s**2 * (3.0 - 2.0 * s) * values[2]
    return np.asarray(ends + s * (1.0 - s) ** 2 * before - s**2 * (1.0 - s) * after)


def _check(motion: Motion, first: int, last: int) -> None:
    if not 0 <= first <= last < motion.frames:
        raise SettingsError("no frames of the motion lie in the range", advice="choose frames of the action")
