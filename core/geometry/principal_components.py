"""Directions of largest variance of poses."""

import numpy as np

from ..geometry.arrays import Array


def principal_components(poses: Array, count: int) -> Array:
    """Return the directions in which poses (N, D) vary most, as orthonormal columns (D, count)."""
    _, directions = np.linalg.eigh(np.cov(poses.T, ddof=0))
    return np.asarray(directions[:, : -count - 1 : -1])
