"""Frames and axes of the standard skeleton's joint angles: the CMU database's.

The frames stand in the ASF files of that database, the same for all its subjects.
"""

from dataclasses import replace

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .skeleton import Skeleton

# joint: (degrees about the fixed x, y, z axes one after another, axes of the joint angles as in `Skeleton`)
_MIDDLE_ORDER = "ZYX"
_LEFT: dict[str, tuple[tuple[float, float, float], str]] = {
    "femur": ((0.0, 0.0, 20.0), "ZYX"),
    "tibia": ((0.0, 0.0, 20.0), "X"),
    "foot": ((-90.0, 0.0, 20.0), "ZX"),
    "toes": ((-90.0, 0.0, 20.0), "X"),
    "clavicle": ((0.0, 0.0, 0.0), "ZY"),
    "humerus": ((180.0, -30.0, -90.0), "ZYX"),
    "radius": ((180.0, -30.0, -90.0), "X"),
    "wrist": ((0.0, 90.0, 90.0), "Y"),
    "hand": ((0.0, 90.0, 90.0), "ZX"),
    "fingers": ((0.0, 90.0, 90.0), "X"),
    "thumb": ((-90.0, 45.0, 0.0), "ZX"),
}


def angle_frame(name: str) -> tuple[Array, str]:
    """Return a joint's rest-from-angle-frame quaternion (4,) and angle order."""
    degrees, order = _LEFT.get(name[1:], ((0.0, 0.0, 0.0), _MIDDLE_ORDER)) if name[:1] in "lr" else ((0.0,) * 3, "ZYX")
    mirror = np.array([1.0, 1.0, 1.0] if name.startswith("l") else [1.0, -1.0, -1.0])
    x, y, z = np.radians(np.array(degrees) * mirror)
    return rot.from_euler(np.array([z, y, x]), "ZYX"), order


def with_angle_frames(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton with the angle frames of the standard skeleton's joints."""
    axes = skeleton.angle_axes.copy()
    orders = list(skeleton.angle_orders)
    for joint, name in enumerate(skeleton.names):
        axes[joint], orders[joint] = angle_frame(name)
    return replace(skeleton, angle_axes=axes, angle_orders=tuple(orders))
