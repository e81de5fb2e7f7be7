"""Poses that a performer holds for calibration and before a capture."""

from collections.abc import Callable

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .skeleton import Skeleton

_HIP_FLEXION_RAD, _KNEE_FLEXION_RAD = np.radians(30.0), np.radians(60.0)
_ARMS_BELOW_LEVEL_RAD = np.radians(20.0)
_ARMS_AWAY_RAD, _HANDS_FORWARD_RAD = np.radians(15.0), np.radians(45.0)


def t_pose(skeleton: Skeleton) -> Array:
    """Return local rotations (J, 4) of a person in a T pose, facing +z.

    The rest pose spreads the legs; a standing person's thighs and shanks hang straight down.
    """
    result = rot.identity((len(skeleton),))
    for side in "lr":
        femur = skeleton.index(f"{side}femur")
        # in CMU's rest pose the foot is tilted with the splayed leg, so turning the leg upright makes it flat
        result[femur] = _upright(skeleton.tips_m[femur])
    return result


def standing(skeleton: Skeleton) -> Array:
    """Return local rotations (J, 4) of a person standing with the arms hanging."""
    result = t_pose(skeleton)
    for side in "lr":
        humerus = skeleton.index(f"{side}humerus")
        result[humerus] = _upright(skeleton.tips_m[humerus])
    return result


def hanging(skeleton: Skeleton) -> Array:
    """Return local rotations (J, 4) of a person in an I pose, arms close to the body.

    The backs of the hands are turned halfway forward, so that cameras in front see the markers on them.
    """
    result = standing(skeleton)
    for side, outward in (("l", 1.0), ("r", -1.0)):
        humerus = skeleton.index(f"{side}humerus")
        turned = rot.from_rotation_vector(np.array([0.0, -outward * _HANDS_FORWARD_RAD, 0.0]))
        away = rot.from_rotation_vector(np.array([0.0, 0.0, outward * _ARMS_AWAY_RAD]))
        result[humerus] = rot.multiply(rot.multiply(away, turned), result[humerus])
    return result


def motorcycle(skeleton: Skeleton) -> Array:
    """Return local rotations (J, 4) of a motorcyclist's pose: arms forward, palms down.

    The feet are flat below the hips, the trunk is upright, and the hands are at chest height, so that they
    do not hide the shoulders from the cameras. The arms are straight, because performers cannot hold an exact elbow
    angle.
    """
    result = t_pose(skeleton)
    for side, outward in (("l", 1.0), ("r", -1.0)):
        femur, tibia, foot = (skeleton.index(side + name) for name in ("femur", "tibia", "foot"))
        upright = result[femur].copy()
        thigh = rot.multiply(_about_left(-_HIP_FLEXION_RAD), upright)
        shank = rot.multiply(_about_left(_KNEE_FLEXION_RAD - _HIP_FLEXION_RAD), upright)
        result[femur] = thigh
        result[tibia] = rot.multiply(rot.conjugate(thigh), shank)
        result[foot] = rot.multiply(rot.conjugate(shank), upright)
        forward = rot.from_rotation_vector(np.array([0.0, -outward * np.pi / 2.0, 0.0]))
        result[skeleton.index(f"{side}humerus")] = rot.multiply(_about_left(_ARMS_BELOW_LEVEL_RAD), forward)
    return result


POSES: dict[str, Callable[[Skeleton], Array]] = {
    "t": t_pose,
    "standing": standing,
    "hanging": hanging,
    "motorcycle": motorcycle,
}
CALIBRATION = ("t", "hanging", "motorcycle")  # poses that together determine the joint centres of the limbs
# instructions for the performer
INSTRUCTIONS = {
    "t": "stand upright, arms straight out to the sides, palms down",
    "standing": "stand upright, arms hanging",
    "hanging": "arms straight down, a hand's breadth from the body, backs of the hands turned halfway forward",
    "motorcycle": "knees bent, arms stretched straight forward, hands at the height of the chest, palms down",
}


def _upright(bone_m: Array) -> Array:
    """Return the rotation (4,) in the frontal plane that makes a bone (3,) hang straight down."""
    return rot.between([bone_m[0], bone_m[1], 0.0], [0.0, -1.0, 0.0])


def _about_left(angle_rad: float) -> Array:
    return rot.from_rotation_vector(np.array([angle_rad, 0.0, 0.0]))
