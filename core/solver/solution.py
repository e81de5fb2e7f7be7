"""Results of the solver: closest examples, fitted pose, solution."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .subject_model import RootPose

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Examples:
    """The database frames closest to a query, closest first.

    Args:
        frames: (K,) frame indices.
        distances: (K,) Eq. 2 distances, up to what all frames share.
        poses: (K, D) float32, their poses.
        markers_m: (K, M, 3) float32, their markers with the root at rest.
    """

    frames: IntArray
    distances: Array
    poses: FloatArray
    markers_m: FloatArray


@dataclass(frozen=True)
class Solution:
    """A solved pose.

    Args:
        pose: (J - 1, 3) relative to the mean rotations.
        root: world pose of the root.
        markers_m: (M, 3) the subject's markers in the world.
        neighbours, dimensions: K and B of the local model; 1 and 0 for the nearest example.
        nearest_m: RMS distance of the observed markers to those of the closest example, metres; NaN when none.
        iterations: of Levenberg-Marquardt or Gauss-Newton.
    """

    pose: Array
    root: RootPose
    markers_m: Array
    neighbours: int
    dimensions: int
    nearest_m: float
    iterations: int


@dataclass(frozen=True)
class Fitted:
    """What a method returns: pose (D,), the root it was fitted under, and the size of its model."""

    pose: Array
    root: RootPose
    neighbours: int
    dimensions: int = 0
    iterations: int = 0
