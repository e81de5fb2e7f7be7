"""Squared distances of stored frames from a query: what a search spends its time on."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...geometry.arrays import FloatArray, IntArray
from ...kernel.library import address, checked, contiguous, function, stage
from ..database_markers import DatabaseMarkers
from .exhaustive import Query, distances_between

_ROWS = function("row_distances", "pnnpnppp")
_FRAMES = function("frame_distances", "pnnpfpnppnpnpfp")


def _compiled_rows(stored: NDArray[Any], rows: IntArray, target: FloatArray, weights: FloatArray) -> FloatArray:
    found = np.empty(len(rows), dtype=np.float32)
    wanted = contiguous(rows, np.int64), len(rows), contiguous(target, np.float32), contiguous(weights, np.float32)
    checked(_ROWS(address(stored), *stored.shape, *wanted, address(found)))
    return found


@stage(_compiled_rows)
def row_distances(stored: NDArray[Any], rows: IntArray, target: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weighted squared distances (K,) of rows (K,) of stored values (F, W) from a target (W,)."""
    away = stored.take(rows, axis=0).astype(np.float32)
    away -= target
    away *= away
    return np.asarray(away @ weights)


def _compiled_frames(markers: DatabaseMarkers, query: Query, poses: FloatArray, frames: IntArray) -> FloatArray:
    target, weights, pose = query.single_precision
    found = np.empty(len(frames), dtype=np.float32)
    stored = address(markers.rows), *markers.rows.shape, address(markers.places), float(markers.unit_m)
    wanted = contiguous(frames, np.int64), len(frames), address(target), address(weights), len(target)
    about = contiguous(poses, np.float32), poses.shape[1], None if pose is None else address(pose), query.pose_weight
    checked(_FRAMES(*stored, *wanted, *about, address(found)))
    return found


@stage(_compiled_frames)
def frame_distances(markers: DatabaseMarkers, query: Query, poses: FloatArray, frames: IntArray) -> FloatArray:
    """Return the Eq. 2 distances (K,) of frames (K,) of a database with poses (F, D)."""
    return distances_between(query, markers.take(frames).reshape(len(frames), 3 * markers.count), poses, frames)
