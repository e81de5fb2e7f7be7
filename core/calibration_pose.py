"""The poses that a performer takes for calibration and before a capture."""

import numpy as np
from numpy.typing import NDArray

from . import rotations as rot
from .skeleton import Skeleton

Array = NDArray[np.float64]


def t_pose(skeleton: Skeleton) -> Array:
    """Return local rotations (J, 4) of a person standing upright, arms out to the sides, facing +z.

    The rest pose spreads the legs; a standing person's thighs and shanks hang straight down.
    """
    result = rot.identity((len(skeleton),))
    for side in "lr":
        femur = skeleton.index(f"{side}femur")
        # in CMU's rest pose the foot leans with the splayed leg, so it comes flat as the leg comes upright
        result[femur] = _upright(skeleton.tips_m[femur])
    return result


def standing(skeleton: Skeleton) -> Array:
    """Return local rotations (J, 4) of a person standing upright with the arms hanging."""
    result = t_pose(skeleton)
    for side in "lr":
        humerus = skeleton.index(f"{side}humerus")
        result[humerus] = _upright(skeleton.tips_m[humerus])
    return result


def _upright(bone_m: Array) -> Array:
    """Return the turn in the frontal plane that lets a bone hang straight down as seen from the front."""
    return rot.between([bone_m[0], bone_m[1], 0.0], [0.0, -1.0, 0.0])
