"""Search among every nth frame of the database, for where time is short."""

import numpy as np

from ...geometry.arrays import FloatArray, IntArray
from .exhaustive import ExhaustiveSearch, Query

_FRAMES = 8192  # that stand for all


class SampleSearch:
    """Search of so many frames in a database of any size.

    Args:
        markers_m, poses: as of `ExhaustiveSearch`.
    """

    def __init__(self, markers_m: FloatArray, poses: FloatArray) -> None:
        self._frames, self._step = len(markers_m), -(-len(markers_m) // _FRAMES)
        self._search = ExhaustiveSearch(markers_m[:: self._step], poses[:: self._step])

    @property
    def visited(self) -> int:
        """Number of distances computed so far."""
        return self._search.visited

    def nearest(self, query: Query, count: int) -> IntArray:
        """Return the `count` closest frames of the sample, ascending."""
        return self._step * self._search.nearest(query, count)[0]

    def around(self, frames: IntArray, least: int = 0) -> IntArray:
        """Return the frames that the first of some frames of the sample stand for.

        The neighbours in time of as many as bring `least` frames; by default of all.
        """
        chosen = frames[: -(-least // self._step)] if least else frames
        found = (chosen[:, None] + np.arange(self._step) - self._step // 2).ravel()
        return found[(found >= 0) & (found < self._frames)]
