"""When feet stand: the ball of the foot (the toe joint) is low and slow.

A foot that stands does so until its ball is clearly faster or higher than when it landed, so that noise at a limit
does not release it.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array, Mask
from .calibration_poses import standing
from .motion import Motion
from .skeleton import Skeleton, forward_kinematics


@dataclass(frozen=True)
class StandingSettings:
    """Limits for standing feet; heights are relative to the ball's height when standing."""

    sole_m: float = 0.02  # height of the lowest joint of a standing foot above the floor
    speed_window_s: float = 0.06  # time over which a speed is measured, because between two frames it is mostly noise
    planted_m_s: float = 0.2  # below this speed a low foot is planted
    lifted_m_s: float = 0.4  # above this speed a planted foot is released
    planted_m: float = 0.05  # below this height a foot can be planted
    lifted_m: float = 0.09  # above this height a planted foot is released

    def beyond_errors(self, lasting_m: float) -> "StandingSettings":
        """Return the limits for feet that seem to move by this standard deviation while they stand, metres."""
        seeming_m_s = lasting_m / self.speed_window_s
        return replace(
            self,
            planted_m_s=self.planted_m_s + seeming_m_s,
            lifted_m_s=self.lifted_m_s + seeming_m_s,
            planted_m=self.planted_m + lasting_m,
            lifted_m=self.lifted_m + lasting_m,
        )

    def stands(self, stood: bool, height_m: float, speed_m_s: float) -> bool:
        """Return whether a foot stands.

        Args:
            stood: Whether it stood before.
            height_m: Height of its ball above that of a standing foot's.
        """
        if stood:
            return height_m <= self.lifted_m and speed_m_s <= self.lifted_m_s
        return height_m < self.planted_m and speed_m_s < self.planted_m_s


STANDING = StandingSettings()


def standing_balls_m(skeleton: Skeleton) -> tuple[float, float]:
    """Return the heights above the floor of a standing person's left and right ball of the foot."""
    heights = forward_kinematics(skeleton, standing(skeleton), np.zeros(3))[0][:, 1]
    found = []
    for side in "lr":
        ankle, ball = heights[skeleton.index(side + "foot")], heights[skeleton.index(side + "toes")]
        found.append(float(ball - min(ankle, ball)) + STANDING.sole_m)
    return found[0], found[1]


def balls_m(motion: Motion) -> Array:
    """Return the positions (F, 2, 3) of the balls of both feet."""
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    return positions[:, [motion.skeleton.index(side + "toes") for side in "lr"]]


def planted_feet(motion: Motion, floor_m: float) -> Mask:
    """Return a mask (F, 2) of the frames in which each foot stands on a floor at this height."""
    balls = balls_m(motion)
    heights = balls[..., 1] - floor_m - standing_balls_m(motion.skeleton)
    half = max(1, round(0.5 * STANDING.speed_window_s * motion.fps))
    frames = np.arange(motion.frames)
    ends = np.minimum(frames + half, motion.frames - 1), np.maximum(frames - half, 0)
    passed_s = np.maximum(ends[0] - ends[1], 1)[:, None] / motion.fps
    speeds = np.linalg.norm(balls[ends[0]] - balls[ends[1]], axis=-1) / passed_s
    found = np.zeros(heights.shape, dtype=np.bool_)
    for foot in range(2):
        stood = False
        for frame, (height, speed) in enumerate(zip(heights[:, foot], speeds[:, foot], strict=True)):
            stood = found[frame, foot] = STANDING.stands(stood, height, speed)
    return found
