"""Search in the cells nearest to the query: an inverted file (Jegou, Douze and Schmid 2011).

The frames in these cells are ranked by their markers and the leading principal components of their poses; only the best
are compared in full. So the search time hardly grows with the database (the number of cells grows with its square
root), and the result for a frame does not depend on the previous frame.
"""

import math

import numpy as np

from ...geometry.arrays import Array, FloatArray, IntArray
from ...geometry.principal_components import principal_components
from ...kernel.library import Packed
from ..database_markers import BESIDE, MOST, DatabaseMarkers
from .exhaustive import Query, closest
from .stored_distances import frame_distances, row_distances

# Approximate number of frames in the cells that are scanned, and their smallest share of the database: the more frames
# it has, the more of the nearest lie in cells beside. Found with ten million on synthetic boxing and kendo.
_SCANNED, _SCANNED_SHARE = 6144, 1 / 200
_FIRST_SCANNED = 2  # factor of this number for queries without a pose
_COMPONENTS = BESIDE - 1
_SAMPLES = 4096  # number of frames from which the components are computed
_COMPARED = 2.0  # number of frames compared in full per frame wanted
_FIRST = 64  # number of closest frames that are sorted by distance
# Assumed cosine of the angle between those parts of the query's pose and of a near pose that the components leave out.
# With this value, the estimated distances rank frames best on takes that are not in the database.
_ALIKE = 0.5
_ROOM = 1.25  # largest value that can be stored, relative to the sample's largest; larger ones are clipped
_CHUNK = 8192  # frames processed at once


class CellSearch:
    """Searches the cells nearest to the query.

    Args:
        markers: Markers that are used by this search only, because it stores its own values after them.
        poses: Poses (F, D) of the database frames.
        scanned: Approximate number of frames to scan; by default it depends on the number of frames.
    """

    def __init__(self, markers: DatabaseMarkers, poses: FloatArray, scanned: int | None = None) -> None:
        self._markers, self._poses = markers, poses
        self._scanned = scanned or max(_SCANNED, round(_SCANNED_SHARE * len(markers)))
        sample = np.ascontiguousarray(poses[:: max(1, len(poses) // _SAMPLES)])
        self._components = principal_components(sample.astype(np.float64), _COMPONENTS).astype(np.float32)
        facts = self._facts_of(sample)
        units = (_ROOM / MOST) * np.abs(facts).max(axis=0) + np.float32(1e-9)
        for start in range(0, len(poses), _CHUNK):
            facts = self._facts_of(poses.take(markers.order[start : start + _CHUNK], axis=0)) / units
            markers.rows[start : start + _CHUNK, -BESIDE:] = np.rint(np.clip(facts, -MOST, MOST))
        self._units = np.concatenate((np.full(3 * markers.count, markers.unit_m), units)).astype(np.float32)
        self._square_units = np.square(self._units)
        self._sizes, self._centres = np.diff(markers.starts), markers.cell_means()
        self._centre_squares = np.square(self._centres)
        self.visited = 0

    def nearest(self, query: Query, count: int, start: IntArray | None = None) -> tuple[IntArray, Array]:
        """Return the `count` closest frames found, closest first, and their Eq. 2 distances."""
        return self.nearest_among(query, self.near(query, count), count)

    def near(self, query: Query, count: int, start: IntArray | None = None) -> IntArray:
        """Return the frames most likely to be closest, about twice `count`; only the first of them are sorted."""
        target, weights = self._target(query)
        rows = self._rows_near(query, target, weights, count)
        estimates = row_distances(self._markers.rows, rows, target, weights)
        compared = min(math.ceil(_COMPARED * count), len(rows) - 1)
        chosen = np.argpartition(estimates, (min(_FIRST, compared), compared))[: compared + 1]
        frames = self._markers.order.take(rows.take(chosen)).astype(np.int64)
        ordered = _FIRST if len(frames) < len(self._markers) else len(frames)
        frames[:ordered] = self.nearest_among(query, frames[:ordered])[0]
        return frames

    def nearest_among(self, query: Query, candidates: IntArray, count: int | None = None) -> tuple[IntArray, Array]:
        """Return the closest `count` candidates, by default all, sorted by Eq. 2 distance, and these distances."""
        distances = frame_distances(self._markers, query, self._poses, candidates)
        order, ascending = closest(distances, count or len(candidates))
        return candidates[order], ascending

    def packed(self, count: int) -> Packed:
        """Return the search for `count` frames of a query with a pose, as the kernel takes it."""
        compared = math.ceil(_COMPARED * count)
        poses = self._poses.shape[1], np.ascontiguousarray(self._poses, dtype=np.float32)
        cells = len(self._centres), self._markers.starts, self._centres
        rows = self._units, self._square_units, BESIDE, np.ascontiguousarray(self._components), _ALIKE
        return Packed(self._markers.packed(), *poses, *cells, *rows, max(self._scanned, compared), compared, _FIRST)

    def room(self, count: int) -> int:
        """Return the number of candidates that the kernel keeps at once in a search for `count` frames."""
        return max(len(self._centres), 4 * (math.ceil(_COMPARED * count) + 1))

    def _facts_of(self, poses: FloatArray) -> FloatArray:
        """Return the leading components of poses, followed by the length of the remainder (K, B)."""
        strongest = poses @ self._components
        rest = np.einsum("fd,fd->f", poses, poses) - np.einsum("fc,fc->f", strongest, strongest)
        return np.column_stack((strongest, np.sqrt(np.maximum(rest, 0.0))))

    def _target(self, query: Query) -> tuple[FloatArray, FloatArray]:
        """Return the query as a row in stored units, and the weights of its squared differences from rows."""
        target, weights = np.zeros((2, len(self._units)), dtype=np.float32)
        target[:-BESIDE], weights[:-BESIDE], pose = query.single_precision
        if pose is not None:
            target[-BESIDE:], weights[-BESIDE:] = self._facts_of(pose[None])[0], query.pose_weight
            target[-1] *= _ALIKE
        return target / self._units, weights * self._square_units

    def _rows_near(self, query: Query, target: FloatArray, weights: FloatArray, count: int) -> IntArray:
        """Return the rows of the cells nearest to a query, enough for `count` frames."""
        known = 1 if query.pose is not None else _FIRST_SCANNED
        scanned = max(self._scanned * known, math.ceil(_COMPARED * count))
        if scanned >= len(self._markers):
            self.visited += len(self._markers)
            return np.arange(len(self._markers))
        away = self._centres @ (-2.0 * weights * target) + self._centre_squares @ weights
        some = min(math.ceil(scanned / len(self._markers) * len(away)), len(away) - 1)
        cells = np.argpartition(away, some)[: some + 1]
        if self._sizes[cells].sum() < _COMPARED * count:
            cells = np.argsort(away)
            cells = cells[: 1 + int(np.searchsorted(np.cumsum(self._sizes[cells]), _COMPARED * count))]
        sizes = self._sizes[cells]
        stops = np.cumsum(sizes)
        self.visited += int(stops[-1]) + len(away)  # each comparison with a cell's mean counts as one frame
        return np.arange(stops[-1]) + np.repeat(self._markers.starts[cells] - stops + sizes, sizes)
