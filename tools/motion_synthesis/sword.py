"""Grip of two hands on a sword."""

import numpy as np

from .arm_rotations import frame_from, hand_rest
from .curves import Array
from .proportions import outward

_FISTS_APART = 0.21 / 0.585  # middles of the two fists along the grip, as a share of the arm's length
_WRIST_TO_FIST, _FIST_ABOVE_PALM = 0.12, 0.035  # shares of the arm's length
# the grip lies diagonally in the palm: the hand's rotation from the blade towards the edge, about its fingers, and
_ASLANT_RAD, _CANT_RAD, _INWARD_RAD = np.deg2rad((25.0, 5.0, 28.0))


def gripping(side: str, left_fist: Array, aim: Array, arm_m: float) -> tuple[Array, Array]:
    """Return a hand's wrist (T, 3) and orientation (T, 4) in the sword's frame.

    Args:
        left_fist: Centre of the left fist (T, 3), metres.
        aim: Elevation, azimuth and edge turn of the blade (T, 3), radians.
        arm_m: Length of the arm.
    """
    blade, edge, flat = sword_axes(aim)
    along, down = _turned_pair(blade, edge, _ASLANT_RAD)
    inside, _ = _turned_pair(-outward(side) * flat, down, _CANT_RAD)
    fingers, palm = _turned_pair(along, inside, _INWARD_RAD)
    middle = left_fist if side == "l" else left_fist + blade * (_FISTS_APART * arm_m)
    wrist = middle - arm_m * (_WRIST_TO_FIST * fingers + _FIST_ABOVE_PALM * palm)
    return wrist, frame_from(*hand_rest(side), fingers, palm)


def _turned_pair(first: Array, second: Array, angle_rad: float) -> tuple[Array, Array]:
    """Return orthogonal directions rotated in their plane, the first towards the second."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return cosine * first + sine * second, cosine * second - sine * first


def sword_axes(aim: Array) -> tuple[Array, Array, Array]:
    """Return directions of blade, edge and flat (blade x edge), each (T, 3)."""
    up, left, turn = aim.T
    blade = np.stack((np.cos(up) * np.sin(left), np.sin(up), np.cos(up) * np.cos(left)), axis=1)
    down = np.stack((np.sin(up) * np.sin(left), -np.cos(up), np.sin(up) * np.cos(left)), axis=1)
    edge = np.cos(turn)[:, None] * down + np.sin(turn)[:, None] * np.cross(blade, down)
    return blade, edge, np.cross(blade, edge)
