"""Soles of the feet: where a foot in any orientation touches the floor.

A sole is a set of points that move with the foot and the toes. The performer's is that of a shoe around the foot's
joints; a character's comes from its mesh (`core/retarget/character_soles.py`).
"""

from dataclasses import dataclass

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .body_size import SOLE_BELOW_TOES_M, girth_scale
from .calibration_poses import t_pose
from .skeleton import Skeleton


@dataclass(frozen=True)
class ShoeShape:
    """Outline of the performer's sole, measured on the mesh of new characters (assets/character.npz)."""

    heel: float = -0.24  # end of the heel behind the ankle, as a fraction of the distance from ankle to toe tip
    tip: float = 1.07  # end of the toes, as the same fraction
    heel_half_m: float = 0.012  # half widths of a body with the default skeleton's size
    ball_half_m: float = 0.030
    tip_half_m: float = 0.006


_SHOE = ShoeShape()


@dataclass(frozen=True)
class Sole:
    """Lower outline of one foot.

    A point lies at R_foot · foot + R_toes · toes from the ankle, with the world rotations of the two joints relative to
    the rest pose.

    Args:
        foot: Shares (P, 3) of the points' positions that turn with the foot, metres.
        toes: Shares (P, 3) that turn with the toes, metres.
    """

    foot: Array
    toes: Array

    @classmethod
    def skinned(cls, points_m: Array, toe_weights: Array, ball_m: Array) -> "Sole":
        """Return the sole of skinned points (P, 3) relative to the ankle at rest.

        Args:
            toe_weights: Shares (P,) of the points' weights that belong to the toes.
            ball_m: Toe joint (3,), or that of each point (P, 3), relative to the ankle at rest.
        """
        share = toe_weights[:, None]
        return cls((1.0 - share) * points_m + share * ball_m, share * (points_m - ball_m))

    def turned(self, foot: Array, toes: Array) -> "Sole":
        """Return the sole of a rest pose in which foot and toes are turned by these rotations (4,)."""
        return Sole(rot.rotate(foot, self.foot), rot.rotate(toes, self.toes))

    def lowest_m(self, foot: Array, toes: Array) -> Array:
        """Return the heights (...) of the lowest points relative to the ankle, negative below it.

        Args:
            foot, toes: World rotations (..., 4) of the joints relative to the rest pose.
        """
        heights = rot.vertical_in(foot) @ self.foot.T + rot.vertical_in(toes) @ self.toes.T
        return np.asarray(heights.min(axis=-1))


def upright_foot(skeleton: Skeleton, side: str) -> Array:
    """Return the world rotation (4,) of the foot of a standing person, whose sole is flat.

    In the standard rest pose the legs are spread, and the feet are tilted with them.
    """
    return np.asarray(t_pose(skeleton)[skeleton.index(side + "femur")])


def performer_sole(skeleton: Skeleton, side: str) -> Sole:
    """Return the sole of a performer's foot, "l" or "r"."""
    toes = skeleton.index(side + "toes")
    upright, girth = upright_foot(skeleton, side), girth_scale(skeleton)
    ball, tip = (rot.rotate(upright, way) for way in (skeleton.offsets_m[toes], skeleton.tips_m[toes]))
    along = (ball + tip) * [1.0, 0.0, 1.0]
    across = np.cross([0.0, 1.0, 0.0], along) / max(float(np.linalg.norm(along)), 1e-9)
    rows = [
        (place + side_m * girth * across, weight)
        for place, half_m, weight in (
            (_SHOE.heel * along, _SHOE.heel_half_m, 0.0),
            (ball * [1.0, 0.0, 1.0], _SHOE.ball_half_m, 0.0),
            (_SHOE.tip * along, _SHOE.tip_half_m, 1.0),
        )
        for side_m in (-half_m, half_m)
    ]
    points = np.array([place for place, _ in rows])
    points[:, 1] = ball[1] - SOLE_BELOW_TOES_M * girth
    flat = Sole.skinned(points, np.array([weight for _, weight in rows]), ball)
    return flat.turned(rot.conjugate(upright), rot.conjugate(upright))


def sole_heights_m(skeleton: Skeleton, positions_m: Array, world: Array) -> Array:
    """Return the heights (..., 2) of the lowest points of the left and right sole.

    Args:
        positions_m: Joint positions (..., J, 3) in the world.
        world: World rotations (..., J, 4) of the joints.
    """
    found = []
    for side in "lr":
        foot, toes = skeleton.index(side + "foot"), skeleton.index(side + "toes")
        lowest_m = performer_sole(skeleton, side).lowest_m(world[..., foot, :], world[..., toes, :])
        found.append(positions_m[..., foot, 1] + lowest_m)
    return np.stack(found, axis=-1)
