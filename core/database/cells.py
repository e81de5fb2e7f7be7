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
_SAMPLES = 4096  # frames that the components are taken from
_CELLS_PER_ROOT = 4.0  # cells per square root of the number of frames
_CHUNK = 8192  # frames


def build_cells(poses: FloatArray, mean_rotations: Array) -> NDArray[np.int32]:
    """Return the cell (F,) of each frame, none empty.

    Args:
        poses: (F, J - 1, 3) rotation vectors.
        mean_rotations: (J, 4) that most of them are relative to.
    """
    skeleton = default_skeleton()
    joints = np.array([skeleton.names.index(name) for name in _CARRIERS])

    def measured(part: slice) -> FloatArray:
        markers_m = markers_at_rest(skeleton, joints, np.zeros((len(joints), 3)), mean_rotations, poses[part])
        rows = (markers_m, poses[part])
        weights = np.sqrt((_MARKERS, _POSES), dtype=np.float32)
        return np.concatenate([w * row.reshape(len(row), -1) for w, row in zip(weights, rows, strict=True)], axis=1)

    sample = measured(slice(None, None, max(1, len(poses) // _SAMPLES)))
    components = principal_components(sample.astype(np.float64), _COMPONENTS).astype(np.float32)
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # numpy computes outside Python's lock
        parts = (slice(start, start + _CHUNK) for start in range(0, len(poses), _CHUNK))
        points = np.concatenate(list(threads.map(lambda part: measured(part) @ components, parts)))
        count = max(1, int(_CELLS_PER_ROOT * np.sqrt(len(points))))
        return clusters_of(points, count, threads.map).astype(np.int32)
