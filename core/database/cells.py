"""Cells of a motion database: groups of frames that are similar by the search's distance.

The distance is Eq. 2 of Chai and Hodgins (2005). The search visits only the cells nearest to its query (an inverted
file; Jegou, Douze and Schmid 2011). Cells are computed for an average body with markers on head, shoulders, hands and
feet; other bodies and marker sets would give similar ones.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.posed_markers import markers_at_rest
from ..body.standard_skeleton import default_skeleton
from ..geometry.arrays import Array, FloatArray
from ..geometry.principal_components import principal_components
from .k_means import clusters_of


@dataclass(frozen=True)
class CellSettings:
    """Settings for the distance between frames and the number of cells."""

    least_frames: int = 16_384  # smallest database with cells; in a smaller one, visiting all frames is as fast
    # joints that carry one marker each
    joints: tuple[str, ...] = ("head", "lhumerus", "lhand", "rhumerus", "rhand", "lfoot", "rfoot")
    markers: float = 0.8  # weight of squared marker distances (m^2), as in the solver's queries
    poses: float = 0.2  # weight of squared joint angles (rad^2)
    components: int = 24  # principal components of markers and poses
    samples: int = 4096  # frames used to compute the components
    ridge: float = 1e-3  # ridge of the regression, rad^2, because some joint angles do not vary
    cells_per_root: float = 4.0  # cells per square root of the number of frames
    chunk: int = 8192  # frames projected at once


SETTINGS = CellSettings()


def build_cells(poses: FloatArray, mean_rotations: Array) -> NDArray[np.int32]:
    """Return the cell (F,) of each frame; no cell is empty.

    Args:
        poses: Rotation vectors (F, J - 1, 3).
        mean_rotations: Common reference pose (J, 4), to which most poses are relative.
    """
    rows, chunk = poses.reshape(len(poses), -1), SETTINGS.chunk
    factors = _factors(poses[:: max(1, len(poses) // SETTINGS.samples)], mean_rotations)
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # NumPy releases the GIL
        starts = range(0, len(rows), chunk)
        points = np.concatenate(list(threads.map(lambda start: rows[start : start + chunk] @ factors, starts)))
        count = int(SETTINGS.cells_per_root * np.sqrt(len(points)))
        return clusters_of(points, count, threads.map).astype(np.int32)


def _factors(poses: FloatArray, mean_rotations: Array) -> FloatArray:
    """Return factors (D, C) that project poses onto principal components of markers and poses.

    Linear regression on the joint angles approximates the components. This avoids forward kinematics for all frames;
    the search then misses 0.3 % of the examples.
    """
    skeleton = default_skeleton()
    joints = np.array([skeleton.names.index(name) for name in SETTINGS.joints])
    markers_m = markers_at_rest(skeleton, joints, np.zeros((len(joints), 3)), mean_rotations, poses)
    angles = poses.reshape(len(poses), -1).astype(np.float64)
    parts = np.sqrt(SETTINGS.markers) * markers_m.reshape(len(poses), -1), np.sqrt(SETTINGS.poses) * angles
    measured = np.concatenate(parts, axis=1)
    measured -= measured.mean(axis=0)
    turned = angles - angles.mean(axis=0)
    components = measured @ principal_components(measured, SETTINGS.components)
    square = turned.T @ turned + SETTINGS.ridge * np.eye(turned.shape[1])
    return np.linalg.solve(square, turned.T @ components).astype(np.float32)
