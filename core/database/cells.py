"""Cells of a motion database: frames alike by the measure of the search (Eq. 2).

The search looks through the cells nearest to its query, an inverted file (Jegou, Douze and Schmid 2011). Cells are made
for a common body that wears markers at head, shoulders, hands and feet: those of other bodies and marker sets are
near where these are.
"""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ..body.posed_markers import markers_at_rest
from ..body.standard_skeleton import default_skeleton
from ..geometry.arrays import Array, FloatArray
from ..geometry.principal_components import principal_components
from .k_means import clusters_of

LARGE_DATABASE = 16_384  # frames from which cells are worth storing: below, looking at all frames costs as little

_CARRIERS = ("head", "lhumerus", "lhand", "rhumerus", "rhand", "lfoot", "rfoot")
_MARKERS, _POSES = 0.8, 0.2  # weights of squared metres and radians, as of the methods' queries
_COMPONENTS = 24  # principal ones of both together, which cells are made by
_SAMPLES = 4096  # frames that they are taken from
_RIDGE = 1e-3  # squared radians, for angles that do not vary
_CELLS_PER_ROOT = 4.0  # cells per square root of the number of frames
_CHUNK = 8192  # frames


def build_cells(poses: FloatArray, mean_rotations: Array) -> NDArray[np.int32]:
    """Return the cell (F,) of each frame, none empty.

    Args:
        poses: (F, J - 1, 3) rotation vectors.
        mean_rotations: (J, 4) that most of them are relative to.
    """
    factors, rows = _factors(poses[:: max(1, len(poses) // _SAMPLES)], mean_rotations), poses.reshape(len(poses), -1)
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # numpy computes outside Python's lock
        starts = range(0, len(rows), _CHUNK)
        points = np.concatenate(list(threads.map(lambda start: rows[start : start + _CHUNK] @ factors, starts)))
        return clusters_of(points, int(_CELLS_PER_ROOT * np.sqrt(len(points))), threads.map).astype(np.int32)


def _factors(poses: FloatArray, mean_rotations: Array) -> FloatArray:
    """Return factors (D, C) of poses for components of markers and poses.

    Markers by a regression: that holds 0.3 % fewer of the examples looked for, without kinematics of all frames.
    """
    skeleton = default_skeleton()
    joints = np.array([skeleton.names.index(name) for name in _CARRIERS])
    markers_m = markers_at_rest(skeleton, joints, np.zeros((len(joints), 3)), mean_rotations, poses)
    angles = poses.reshape(len(poses), -1).astype(np.float64)
    measured = np.concatenate((np.sqrt(_MARKERS) * markers_m.reshape(len(poses), -1), np.sqrt(_POSES) * angles), axis=1)
    measured -= measured.mean(axis=0)
    turned = angles - angles.mean(axis=0)
    components = measured @ principal_components(measured, _COMPONENTS)
    square = turned.T @ turned + _RIDGE * np.eye(turned.shape[1])
    return np.linalg.solve(square, turned.T @ components).astype(np.float32)
