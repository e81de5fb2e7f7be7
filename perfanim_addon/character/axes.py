"""Conversion from the capture space (x to the performer's left, y up, z forward) to Blender (Z up, facing -Y)."""

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry.arrays import Array

BLENDER_FROM_WORLD: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def points_to_blender(points_m: ArrayLike) -> Array:
    """Return points or vectors (..., 3) of the capture space in Blender's axes: (x, -z, y)."""
    return np.asarray(points_m, dtype=np.float64) @ BLENDER_FROM_WORLD.T
