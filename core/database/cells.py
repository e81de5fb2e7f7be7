"""Cells of a motion database: groups of frames that are similar in the distance measure of the search (Eq. 2).

The search visits only the cells nearest to its query (an inverted file; Jegou, Douze and Schmid 2011). Cells are made
for an average body with markers on head, shoulders, hands and feet, which are close to those of other bodies and sets.
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
    """Distance measure and number of cells."""

    least_frames: int = 16_384  # fewest frames for which cells pay: below, visiting all frames costs as little
    joints: tuple[str, ...] = ("head", "lhumerus", "lhand", "rhumerus", "rhand", "lfoot", "rfoot")  # with markers
    markers: float = 0.8  # weight of squared metres, as in the solver's queries
    poses: float = 0.2  # weight of squared radians
    components: int = 24  # principal components of markers and poses
    samples: int = 4096  # frames used to compute the components
    ridge: float = 1e-3  # squared radians added for angles that do not vary
    cells_per_root: float = 4.0  # cells per square root of the number of frames
    chunk: int = 8192  # frames projected at once


SETTINGS = CellSettings()


def build_cells(poses: FloatArray, mean_rotations: Array) -> NDArray[np.int32]:
    """Return the cell (F,) of each frame; no cell is empty.

    Args:
        poses: Rotation vectors (F, J - 1, 3).
        mean_rotations: Rotations (J, 4) that most poses are relative to.
    """
    rows, chunk = poses.reshape(len(poses), -1), SETTINGS.chunk
    factors = _factors(poses[:: max(1, len(poses) // SETTINGS.samples)], mean_rotations)
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # numpy releases Python's lock
        starts = range(0, len(rows), chunk)
        points = np.concatenate(list(threads.map(lambda start: rows[start : start + chunk] @ factors, starts)))
        count = int(SETTINGS.cells_per_root * np.sqrt(len(points)))
        return clusters_of(points, count, threads.map).astype(np.int32)


def _factors(poses: FloatArray, mean_rotations: Array) -> FloatArray:
    """Return factors (D, C) that project poses on principal components of markers and poses.

    The markers are approximated by a linear regression, which avoids forward kinematics of all frames and misses 0.3 %
    the examples.
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
