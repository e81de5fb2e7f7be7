"""Body lengths used to plan motion, and small geometric functions that the behaviours share."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.geometry import rotations as rot

Array = NDArray[np.float64]

SIDES = ("l", "r")
GRAVITY_M_S2 = 9.81


def about(axis: str, angles: Array) -> Array:
    """Return rotations (..., 4) by `angles` (...) about one axis, "X", "Y" or "Z"."""
    return rot.from_euler(np.asarray(angles, dtype=np.float64)[..., None], axis)


def outward(side: str) -> float:
    """Return the sign of x that points away from the body on a side."""
    return 1.0 if side == "l" else -1.0


def facing_front(heading_rad: float) -> float:
    """Return the heading that faces the cameras and is nearest to another heading (whole turns add up)."""
    return float(2.0 * np.pi * np.round(heading_rad / (2.0 * np.pi)))


def turned(heading_rad: float | Array, forward: float | Array, left: float | Array) -> tuple[Array, Array]:
    """Convert a ground vector of a body that faces `heading_rad` (0: +z) to world (x, z)."""
    sine, cosine = np.sin(heading_rad), np.cos(heading_rad)
    return forward * sine + left * cosine, forward * cosine - left * sine


@dataclass(frozen=True)
class Sole:
    """Ground points of a foot, in the frame of a foot that stands flat, facing +z."""

    ball_height_m: float  # height of the toe joint above the ground
    ankle_m: Array  # (3,) relative to the ball
    heel_m: Array  # (3,) lowest point relative to the ball
    toe_m: float  # length of the toes
    flat: Array  # (4,) world-from-foot orientation of the flat foot


@dataclass(frozen=True)
class Body:
    """A skeleton with the lengths used to plan motion."""

    skeleton: Skeleton

    @cached_property
    def leg_m(self) -> float:
        """Distance from hip to ankle with the leg straight."""
        return sum(self.lengths("ltibia", "lfoot"))

    @cached_property
    def arm_m(self) -> float:
        """Distance from shoulder to wrist with the arm straight."""
        return sum(self.lengths("lradius", "lwrist", "lhand"))

    @cached_property
    def standing_m(self) -> float:
        """Height of the root with straight vertical legs and flat feet."""
        sole = self.sole("l")
        return float(sole.ball_height_m + sole.ankle_m[1] + self.leg_m - self.offset("lfemur")[1])

    @cached_property
    def stance_m(self) -> float:
        """Half the distance between the feet in relaxed standing."""
        return float(1.05 * self.offset("lfemur")[0])

    def offset(self, joint: str) -> Array:
        """Return the joint's offset from its parent, (3,) metres."""
        return np.asarray(self.skeleton.offsets_m[self.skeleton.index(joint)])

    def lengths(self, *joints: str) -> list[float]:
        """Return the distances of joints from their parents."""
        return [float(np.linalg.norm(self.offset(joint))) for joint in joints]

    def sole(self, side: str) -> Sole:
        """Return the ground contact geometry of a foot.

        In the rest pose the foot leans with the splayed leg; it is flat when the shank is vertical.
        """
        shank = self.offset(f"{side}foot")
        flat = rot.between(shank / np.linalg.norm(shank), np.array([0.0, -1.0, 0.0]))
        ball = rot.rotate(flat, self.offset(f"{side}toes"))
        toe = float(np.linalg.norm(self.skeleton.tips_m[self.skeleton.index(f"{side}toes")]))
        # the centre of the first toe joint lies about a fifth of the foot bone's length above the ground
        height = 0.2 * float(np.linalg.norm(ball))
        heel = np.array([-ball[0], -height, -ball[2] - 0.33 * float(np.linalg.norm(ball))])
        return Sole(height, -ball, heel, toe, flat)
