"""Posture of a body in the world, and correction of motion that is upside down."""

from dataclasses import dataclass, replace

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .motion import Motion
from .skeleton import Skeleton, forward_kinematics


@dataclass(frozen=True)
class PostureSettings:
    """Thresholds for a body that is upside down throughout a motion."""

    samples: int = 600  # largest number of frames that are checked
    upright: float = 0.5  # cosine between up and trunk or thighs above which a body stands, sits or crawls
    upright_share: float = 0.1  # smallest share of upright frames in the motion of a body that is upright at times


_S = PostureSettings()
_ENDS = ("root", "head", "lhand", "rhand")
_HALF_TURN = np.array([0.0, 1.0, 0.0, 0.0])  # about the x axis


@dataclass(frozen=True)
class Posture:
    """Posture of a body in F frames of a motion.

    Args:
        positions_m: Joints (F, J, 3).
        trunk: Cosine (F,) between up and the direction from the hips to the neck.
        upright: Cosine (F,) between up and the trunk or the thighs, whichever is more upright.
    """

    skeleton: Skeleton
    positions_m: Array
    trunk: Array
    upright: Array

    @property
    def is_never_upright(self) -> bool:
        """Whether the body lies or is upside down throughout the motion."""
        return bool(np.percentile(self.upright, 100.0 * (1.0 - _S.upright_share)) < _S.upright)

    @property
    def is_upside_down(self) -> bool:
        """Whether the body is upside down throughout the motion."""
        return self.is_never_upright and bool(np.median(self.trunk) < -_S.upright)

    @property
    def world_is_upside_down(self) -> bool:
        """Whether the world itself is upside down: the body is below the floor, or its hands above its head."""
        root, head, *hands = (self.positions_m[:, self.skeleton.index(name), 1] for name in _ENDS)
        is_below = np.median(root) < 0.0
        return self.is_upside_down and bool(is_below or np.median(np.minimum(*hands) - head) > 0.0)


def posture_of(motion: Motion) -> Posture:
    """Return the posture in frames spread over a motion."""
    step = -(-motion.frames // _S.samples)
    skeleton, index = motion.skeleton, motion.skeleton.index
    positions = forward_kinematics(skeleton, motion.rotations[::step], motion.root_positions_m[::step])[0]
    hips, knees = (positions[:, [index(side + bone) for side in "lr"]] for bone in ("femur", "tibia"))
    trunk = _rise(positions[:, 0], positions[:, index("upperneck")])
    return Posture(skeleton, positions, trunk, np.maximum(trunk, _rise(knees, hips).mean(axis=1)))


def turned_upright(motion: Motion) -> Motion | None:
    """Return the motion turned over if its world is upside down, otherwise None.

    In a handstand, or hanging by the feet, a performer is above the floor with the hands below the head, which is left
    as it is.
    """
    if not posture_of(motion).world_is_upside_down:
        return None
    positions = motion.root_positions_m * [1.0, -1.0, -1.0]
    height_m = float(np.median(positions[:, 1]))
    positions[:, 1] += 2.0 * max(0.0, -height_m)  # a root that was above the floor keeps its height
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(_HALF_TURN, rotations[:, 0])
    return replace(motion, rotations=rotations, root_positions_m=positions)


def _rise(starts: Array, ends: Array) -> Array:
    """Return the cosines (...) between up and the directions from starts (..., 3) to ends (..., 3)."""
    way = ends - starts
    return np.asarray(way[..., 1] / np.maximum(np.linalg.norm(way, axis=-1), 1e-9))
