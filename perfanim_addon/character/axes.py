"""Directions of world space in Blender's axes.

World space: metres, x to the performer's left, y up, z forward. Blender: Z up, characters face -Y. Pure numpy: nothing
of Blender is imported.
"""

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry.arrays import Array

BLENDER_FROM_WORLD: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def points_to_blender(points_m: ArrayLike) -> Array:
    """Return points or vectors (..., 3) of world space in Blender's axes: (x, -z, y)."""
    return np.asarray(points_m, dtype=np.float64) @ BLENDER_FROM_WORLD.T
