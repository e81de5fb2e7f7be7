"""A two-handed sword: how the hands hold it, and where it is in a motion."""

import numpy as np

from ... import rotations as rot
from ...motion import Motion
from ...skeleton import forward_kinematics
from .curves import Array
from .frame import Body, outward
from .limbs import frame_from

LENGTH_M = 1.15  # pommel to tip
POMMEL_M = 0.04  # from the middle of the left fist back to the end
_FISTS_APART_M = 0.21  # middles of the two fists along the grip, for an arm of 0.585 m
_ARM_M = 0.585
_WRIST_TO_FIST = 0.12  # share of the arm's length
_FIST_ABOVE_PALM = 0.035
# the grip lies aslant in the palm: the hand's turn from the blade towards the edge, about its fingers, and inwards
_ASLANT_RAD, _CANT_RAD, _INWARD_RAD = np.deg2rad((25.0, 5.0, 28.0))


def gripping(side: str, left_fist: Array, aim: Array, body: Body) -> tuple[Array, Array]:
    """Return a hand's wrist (T, 3) and orientation (T, 4) on a sword, in the frame in which the sword is given.

    Args:
        left_fist: (T, 3) middle of the left fist, metres.
        aim: (T, 3) elevation, azimuth and edge turn of the blade, radians.
    """
    blade, edge, flat = sword_axes(aim)
    along, down = _turned_pair(blade, edge, _ASLANT_RAD)
    inside, _ = _turned_pair(-outward(side) * flat, down, _CANT_RAD)
    fingers, palm = _turned_pair(along, inside, _INWARD_RAD)
    scale = body.arm_m
    middle = left_fist if side == "l" else left_fist + blade * (_FISTS_APART_M / _ARM_M * scale)
    wrist = middle - scale * (_WRIST_TO_FIST * fingers + _FIST_ABOVE_PALM * palm)
    rest = np.array([outward(side), 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
    return wrist, frame_from(*rest, fingers, palm)


def _turned_pair(first: Array, second: Array, angle_rad: float) -> tuple[Array, Array]:
    """Return two orthogonal directions turned within their plane, the first towards the second."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return cosine * first + sine * second, cosine * second - sine * first


def sword_axes(aim: Array) -> tuple[Array, Array, Array]:
    """Return the blade's direction, the edge's, and the flat's (blade x edge), each (T, 3)."""
    up, left, turn = aim.T
    blade = np.stack((np.cos(up) * np.sin(left), np.sin(up), np.cos(up) * np.cos(left)), axis=1)
    down = np.stack((np.sin(up) * np.sin(left), -np.cos(up), np.sin(up) * np.cos(left)), axis=1)
    across = np.cross(blade, down)
    edge = np.cos(turn)[:, None] * down + np.sin(turn)[:, None] * across
    return blade, edge, np.cross(blade, edge)


def sword_ends(motion: Motion) -> tuple[Array, Array]:
    """Return the pommel's and the tip's world positions (F, 3) of a sword fixed in the right hand of a motion."""
    body = Body(motion.skeleton)
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    hand = motion.skeleton.index("rhand")
    tip, pommel = (sword_in_hand(body, along) for along in (LENGTH_M - POMMEL_M, -POMMEL_M))
    turn = world[:, hand]
    return positions[:, hand] + rot.rotate(turn, pommel), positions[:, hand] + rot.rotate(turn, tip)


def sword_in_hand(body: Body, along_m: float) -> Array:
    """Return the point of the sword `along_m` from the left fist to the tip, in the right hand's frame (3,)."""
    wrist, hand = gripping("r", np.zeros((1, 3)), np.zeros((1, 3)), body)
    blade, _, _ = sword_axes(np.zeros((1, 3)))
    return np.asarray(rot.rotate(rot.conjugate(hand), along_m * blade - wrist)[0])
