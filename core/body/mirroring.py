"""Mirroring motion: left and right exchanged across the plane x = 0.

In the rest pose all joint axes are the world's, so a rotation is mirrored by giving it to the other side's joint
with the axis reflected: (w, x, y, z) becomes (w, x, -y, -z). In points and offsets, x changes its sign.
"""

import re
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .skeleton import Skeleton
from .standard_skeleton import JOINT_NAMES, mirrored_name

_OTHER_SIDE = np.array([JOINT_NAMES.index(mirrored_name(name)) for name in JOINT_NAMES])
_QUATERNION_SIGNS = np.array([1.0, 1.0, -1.0, -1.0], dtype=np.float32)
_POINT_SIGNS = np.array([-1.0, 1.0, 1.0], dtype=np.float32)
_SIDES = {"left": "right", "right": "left"}


def mirrored_rotations(rotations: NDArray[Any]) -> NDArray[Any]:
    """Return the mirror image of rotations (..., J, 4), including the root's."""
    return rotations[..., _OTHER_SIDE, :] * _QUATERNION_SIGNS


def mirrored_points(points_m: NDArray[Any]) -> NDArray[Any]:
    """Return the mirror image of points (..., 3)."""
    return points_m * _POINT_SIGNS


def mirrored_skeleton(skeleton: Skeleton) -> Skeleton:
    """Return the mirror image of a body."""
    return replace(
        skeleton,
        offsets_m=mirrored_points(skeleton.offsets_m[_OTHER_SIDE]),
        tips_m=mirrored_points(skeleton.tips_m[_OTHER_SIDE]),
        angle_axes=skeleton.angle_axes[_OTHER_SIDE] * _QUATERNION_SIGNS,
        angle_orders=tuple(skeleton.angle_orders[joint] for joint in _OTHER_SIDE),
    )


def mirrored_behaviour(behaviour: str) -> str:
    """Return a behaviour's name with left and right exchanged: "walk-turn-left" -> "walk-turn-right"."""
    return re.sub(r"(?<![a-z])(left|right)(?![a-z])", lambda match: _SIDES[match[1]], behaviour)
