"""One cycle of a walk that can be repeated.

The cycle lies between two moments whose poses and speeds are most alike. It is straightened, so that it can be repeated
without a turn, and its end is blended with what leads to its start.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import SettingsError
from ..geometry import rotations as rot
from .motion import Motion, sliced
from .moved_feet import floor_height_m, hold_planted, smooth_step
from .seams import about_vertical, heading
from .skeleton import forward_kinematics
from .standing_feet import planted_feet


@dataclass(frozen=True)
class LoopSettings:
    """Search for a cycle."""

    shortest_s: float = 0.6
    longest_s: float = 3.0
    searched_s: float = 30.0  # time from the start of the motion that is searched
    blend_s: float = 0.3  # time before the end of the cycle in which it is blended
    speed_s: float = 0.1  # weight of the speeds of joints beside their positions
    least_step_m: float = 0.15  # smallest way of both feet against the hips
    alike_m: float = 0.15  # largest mean distance of the joints of two moments that are alike


_SETTINGS = LoopSettings()


def looped(motion: Motion) -> Motion:
    """Return one cycle of a walk; its last frame is the pose of its first, farther along its way.

    Raises:
        SettingsError: The motion is too short, or no two moments of it are alike.
    """
    motion = sliced(motion, 0, min(motion.frames, round(_SETTINGS.searched_s * motion.fps)))
    lead = max(2, round(_SETTINGS.blend_s * motion.fps))
    start, stop = _cycle(motion, lead)
    cycle, length = _straightened(sliced(motion, start - lead, stop + 1), lead), stop - start
    weight = smooth_step(np.arange(lead + 1) / lead)
    rotations, roots_m = cycle.rotations.copy(), cycle.root_positions_m.copy()
    rows, source = np.arange(length, length + lead + 1), np.arange(lead + 1)
    way_m = (roots_m[-1] - roots_m[lead]) * [1.0, 0.0, 1.0]
    rotations[rows] = rot.slerp(rotations[rows], rotations[source], weight[:, None])
    roots_m[rows] += weight[:, None] * (roots_m[source] + way_m - roots_m[rows])
    mixed = sliced(replace(cycle, rotations=rotations, root_positions_m=roots_m), lead, lead + length + 1)
    # feet are held across the seam, too
    return sliced(hold_planted(repeated(mixed, 3)), length, 2 * length + 1)


def repeated(cycle: Motion, times: int) -> Motion:
    """Return a cycle repeated some times, each from where the last one ended."""
    length = cycle.frames - 1
    way_m = (cycle.root_positions_m[-1] - cycle.root_positions_m[0]) * [1.0, 0.0, 1.0]
    rounds, rows = np.divmod(np.arange(length * times + 1), length)
    rotations = rot.continuous(cycle.rotations[rows])
    return replace(cycle, rotations=rotations, root_positions_m=cycle.root_positions_m[rows] + rounds[:, None] * way_m)


def _cycle(motion: Motion, lead: int) -> tuple[int, int]:
    """Return the first and last frame of the cycle; at least `lead` frames come before it."""
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    back = rot.conjugate(about_vertical(heading(motion.rotations[:, 0])))
    own = rot.rotate(back[:, None], positions - positions[:, :1] * [1.0, 0.0, 1.0])
    shortest, longest = (round(s * motion.fps) for s in (_SETTINGS.shortest_s, _SETTINGS.longest_s))
    if motion.frames <= lead + shortest + 1:
        raise SettingsError("the motion is too short for a cycle", advice="choose at least two steps of each foot")
    speeds = np.gradient(own, axis=0) * motion.fps
    features = np.concatenate((own, _SETTINGS.speed_s * speeds), axis=-1).reshape(motion.frames, -1)
    apart = np.full((motion.frames, motion.frames), np.inf)  # of each first and last frame
    for length in range(shortest, min(longest, motion.frames - 1) + 1):
        distances = np.linalg.norm(features[length:] - features[:-length], axis=1)
        np.fill_diagonal(apart[:, length:], distances / np.sqrt(positions.shape[1]))
    steps = own[:, [motion.skeleton.index(side + "toes") for side in "lr"], 2]
    moved = np.array([[np.ptp(steps[row : row + shortest], axis=0).min()] for row in range(motion.frames)])
    usable = (np.arange(motion.frames)[:, None] >= lead) & (moved > _SETTINGS.least_step_m)
    apart = np.where(usable, apart, np.inf)
    start, stop = np.unravel_index(int(np.argmin(apart)), apart.shape)
    if not apart[start, stop] < _SETTINGS.alike_m:
        raise SettingsError("no two moments of the motion are alike", advice="choose a part with steady steps")
    return int(start), int(stop)


def _straightened(motion: Motion, first: int) -> Motion:
    """Return a motion whose heading in its last frame is that in the frame `first`; standing feet do not slide."""
    last = motion.frames - 1
    angle = heading(motion.rotations[:, 0])
    turned = (angle[last] - angle[first] + np.pi) % (2.0 * np.pi) - np.pi
    turns = about_vertical(-turned * (np.arange(motion.frames) - first) / (last - first))
    steps = rot.rotate(turns[1:], np.diff(motion.root_positions_m, axis=0))
    roots_m = np.concatenate((motion.root_positions_m[:1], motion.root_positions_m[0] + np.cumsum(steps, axis=0)))
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(turns, rotations[:, 0])
    planted = planted_feet(motion, floor_height_m(motion))
    return hold_planted(replace(motion, rotations=rotations, root_positions_m=roots_m), planted)
