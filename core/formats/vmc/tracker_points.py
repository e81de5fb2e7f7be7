"""Points around a tracker that represent its rotation, which a single marker would lose."""

import numpy as np

from ...geometry import rotations as rot
from ...geometry.arrays import Array


def axis_names(tracker: str) -> tuple[str, ...]:
    """Return the names of the points that `axis_points` returns."""
    return tuple(f"{tracker} {axis}" for axis in "xyz")


def axis_points(position_m: Array, rotation: Array, length_m: float = 0.1) -> Array:
    """Return points (..., 3, 3) on the axes of trackers at positions (..., 3) with rotations (..., 4).

    Args:
        length_m: Distance from the tracker; with 0.1 m one degree of rotation counts as much as 2 mm of position.
    """
    return position_m[..., None, :] + rot.rotate(rotation[..., None, :], length_m * np.eye(3))
