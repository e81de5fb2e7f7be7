"""Search in an inverted file (IVF, Jegou, Douze and Schmid 2011).

Cells hold frames of similar poses, and only the cells closest to the query are searched. No frame depends on the one
before.
"""

import numpy as np
from numpy.typing import NDArray

from ...geometry.arrays import Array, FloatArray, IntArray
from .exhaustive import ExhaustiveSearch, Query, closest

_PROBED = 16  # cells
_PROBED_PER_WANTED = 4.0  # frames looked at, at least, for each one wanted


class CellSearch:
    """Searches the cells with the mean frames closest to the query.

    Args:
        markers_m, poses: as of `ExhaustiveSearch`.
        cells: (F,) cell of each frame, none empty.
        probed: cells to search at least.
    """

    def __init__(
        self, markers_m: FloatArray, poses: FloatArray, cells: NDArray[np.int32], probed: int = _PROBED
    ) -> None:
        self._order = np.argsort(cells, kind="stable")
        counts = np.bincount(cells)
        self._starts = np.concatenate(([0], np.cumsum(counts)))
        # in the order of their cells, so that a cell is one stretch of memory
        markers, poses = markers_m.reshape(len(markers_m), -1)[self._order], np.asarray(poses)[self._order]
        self._frames = ExhaustiveSearch(markers, poses)
        self._place = np.empty_like(self._order)
        self._place[self._order] = np.arange(len(self._order))
        means = [np.add.reduceat(rows, self._starts[:-1], axis=0) / counts[:, None] for rows in (markers, poses)]
        self._cells = ExhaustiveSearch(means[0].astype(np.float32), means[1].astype(np.float32))
        self._probed = probed
        self.visited = 0

    def nearest(self, query: Query, count: int, start: IntArray | None = None) -> tuple[IntArray, Array]:
        """Return the `count` closest frames found (ascending) and their Eq. 2 distances."""
        cells, _ = self._cells.nearest(query, len(self._cells))
        sizes = np.cumsum(self._starts[cells + 1] - self._starts[cells])
        enough = int(np.searchsorted(sizes, min(_PROBED_PER_WANTED * count, sizes[-1]))) + 1
        probed = np.sort(cells[: max(self._probed, enough)])
        parts = [slice(self._starts[cell], self._starts[cell + 1]) for cell in probed]
        distances = np.concatenate([self._frames.distances(query, part) for part in parts])
        self.visited += len(distances) + len(self._cells)  # means of cells count like frames
        chosen, found = closest(distances, count)
        places = np.concatenate([np.arange(part.start, part.stop) for part in parts])
        return self._order[places[chosen]], found

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return the candidate frames by their Eq. 2 distances, ascending, and these."""
        order, distances = closest(self._frames.distances(query, self._place[candidates]), len(candidates))
        return candidates[order], distances
