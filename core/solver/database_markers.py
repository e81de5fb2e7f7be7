"""A subject's markers in all frames of a database, stored compactly."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..database.store import Database
from ..geometry import rotations as rot
from ..geometry.arrays import FloatArray, IntArray
from ..kernel.library import Packed
from .subject_model import SubjectModel

MOST = np.iinfo(np.int16).max  # largest stored coordinate, in units
BESIDE = 17  # number B of values that a search stores after each frame's markers, so that its data are contiguous
_CHUNK = 4096  # number of frames posed at once: fewer would mean more calls, more would exceed the CPU cache
_CELLS = 64  # number of cells averaged at once


class DatabaseMarkers:
    """Markers (Eq. 1) of a database's frames with the root at rest, sorted by cell.

    Args:
        cells: Cell (F,) of each frame, see `build_cells`.
        posed: Function that returns the markers (K, M, 3), metres, of frames (K,).
        reach_m: Upper bound on the absolute values of the coordinates, metres.

    Attributes:
        count: Number of markers M.
        unit_m: Unit of the stored coordinates, a few hundredths of a millimetre.
        rows: Rows (F, 3 M + B) in the order of the cells: coordinates, then space for the values of one search.
        order: Frame (F,) of each row.
        places: Row (F,) of each frame.
        starts: First row (C + 1,) of each cell; the additional last entry is F.
    """

    def __init__(self, cells: NDArray[Any], posed: Callable[[NDArray[Any]], FloatArray], reach_m: float) -> None:
        self.order: NDArray[np.int32] = np.argsort(cells, kind="stable").astype(np.int32)
        sizes = np.bincount(cells)
        self.starts: IntArray = np.concatenate(([0], np.cumsum(sizes[sizes > 0])))
        self.places: NDArray[np.int32] = np.empty_like(self.order)
        self.places[self.order] = np.arange(len(cells), dtype=np.int32)
        self.unit_m, self.count = np.float32(reach_m / MOST), posed(self.order[:1]).size // 3
        self.rows: NDArray[np.int16] = np.zeros((len(cells), 3 * self.count + BESIDE), dtype=np.int16)
        for start in range(0, len(cells), _CHUNK):
            frames = self.order[start : start + _CHUNK]
            points = posed(frames).reshape(len(frames), -1) / self.unit_m
            self.rows[start : start + _CHUNK, : points.shape[1]] = np.rint(np.clip(points, -MOST, MOST))

    def packed(self) -> Packed:
        """These markers as the kernel takes them."""
        return Packed(*self.rows.shape, self.count, self.rows, self.order, self.places, float(self.unit_m))

    def __len__(self) -> int:
        return len(self.rows)

    def cell_means(self) -> FloatArray:
        """Return the means (C, 3 M + B) of the rows of each cell."""
        sizes, means = np.diff(self.starts), []
        for first in range(0, len(sizes), _CELLS):
            starts = self.starts[first : first + _CELLS + 1]
            part = self.rows[starts[0] : starts[-1]].astype(np.float32)
            means.append(np.add.reduceat(part, starts[:-1] - starts[0], axis=0))
        return np.concatenate(means) / sizes[:, None].astype(np.float32)

    def take(self, frames: NDArray[Any]) -> FloatArray:
        """Return the markers (..., M, 3) of frames (...)."""
        rows = self.rows.take(self.places.take(frames), axis=0)
        return (rows[..., : 3 * self.count] * self.unit_m).reshape(*frames.shape, self.count, 3)

    def all(self) -> FloatArray:
        """Return the markers (F, M, 3) of all frames, in the order of the frames."""
        return self.take(np.arange(len(self)))


def database_markers(subject: SubjectModel, database: Database) -> DatabaseMarkers:
    """Return a subject's markers in all frames of a database; a database without cells is treated as one cell."""
    cells = np.zeros(database.frames, dtype=np.int32) if database.cells is None else database.cells
    bones_m = rot.lengths(subject.skeleton.offsets_m)
    bones_m[0] = 0.0  # the root is at the origin
    reach_m = np.max(subject.skeleton.is_ancestor[subject.joints] @ bones_m + rot.lengths(subject.offsets_m))
    return DatabaseMarkers(cells, lambda frames: subject.database_markers(database, frames), max(float(reach_m), 0.01))
