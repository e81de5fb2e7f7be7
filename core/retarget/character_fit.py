"""Facts about a character beyond its bones: the skin of its feet, and corrections that are kept with it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array


@dataclass(frozen=True)
class Adjustments:
    """Corrections that apply to each pose of a character.

    Args:
        hip_height_m: Height added to the hips, in the performer's metres; the legs bend or stretch.
        shoulder_deg: Angle by which the clavicles are raised.
        arm_spread_deg: Angle by which hanging arms are moved away from the body.
        foot_pitch_deg: Angle by which the toes are raised; the soles stay on the floor.
    """

    hip_height_m: float = 0.0
    shoulder_deg: float = 0.0
    arm_spread_deg: float = 0.0
    foot_pitch_deg: float = 0.0

    def turns(self, joints: Mapping[str, int]) -> dict[str, Array]:
        """Return joint -> rotation (4,) in the standard rest pose, for the joints whose whole limb is turned."""
        raised = {"clavicle": self.shoulder_deg, "humerus": self.arm_spread_deg}
        return {
            side + name: rot.from_rotation_vector(np.radians([0.0, 0.0, sign * angle_deg]))
            for side, sign in (("l", 1.0), ("r", -1.0))
            for name, angle_deg in raised.items()
            if angle_deg and side + name in joints
        }


@dataclass(frozen=True)
class SkinPoints:
    """Points of a mesh that a foot moves, in armature space at rest.

    Args:
        points: Positions (P, 3).
        toe_weights: Shares (P,) of their weights that belong to the toes.
        shank: Positions (S, 3) of points near the foot that the shank moves.
    """

    points: Array
    toe_weights: Array
    shank: Array = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True)
class CharacterFit:
    """Skin and corrections of a character.

    Args:
        skins: Side ("l", "r") -> points of the foot's mesh; without them, the lowest bones are the sole.
    """

    skins: Mapping[str, SkinPoints] = field(default_factory=dict)
    adjustments: Adjustments = Adjustments()


PLAIN_FIT = CharacterFit()
