"""Points around a tracker that stand for its rotation.

A marker takes three numbers from a tracker; its rotation, which a tracker on the waist has instead of three markers,
would be lost.
"""

import numpy as np

from ...geometry import rotations as rot
from ...geometry.arrays import Array

AXES = ("x", "y", "z")
_LENGTH_M = 0.1  # so that a degree of rotation is as much as two millimetres of place


def axis_names(tracker: str) -> tuple[str, ...]:
    """Return the names of the points of `axis_points`."""
    return tuple(f"{tracker} {axis}" for axis in AXES)


def axis_points(position_m: Array, rotation: Array) -> Array:
    """Return points (..., 3, 3), 0.1 m along each tracker's axis.

    Positions are (..., 3), rotations (..., 4).
    """
    return position_m[..., None, :] + rot.rotate(rotation[..., None, :], _LENGTH_M * np.eye(3))
