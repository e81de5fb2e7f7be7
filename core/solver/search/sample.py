"""Search in a sample of the database, every nth frame, for marker frames that must be solved quickly."""

import numpy as np

from ...geometry.arrays import FloatArray, IntArray
from ..database_markers import DatabaseMarkers
from .exhaustive import ExhaustiveSearch, Query

_FRAMES = 8192  # largest sample


class SampleSearch:
    """Search among a limited number of frames in a database of any size.

    Args:
        poses: Poses (F, D) of the database frames.

    Attributes:
        step: Number of database frames that each frame of the sample represents.
    """

    def __init__(self, markers: DatabaseMarkers, poses: FloatArray) -> None:
        self._frames, self.step = len(markers), -(-len(markers) // _FRAMES)
        sample = np.arange(0, self._frames, self.step)
        self._search = ExhaustiveSearch(markers.take(sample), poses[:: self.step])

    @property
    def visited(self) -> int:
        """Number of distances computed so far."""
        return self._search.visited

    def nearest(self, query: Query, count: int) -> IntArray:
        """Return the `count` closest frames of the sample, closest first, as indices of database frames."""
        return self.step * self._search.nearest(query, count)[0]

    def around(self, frames: IntArray, least: int = 0, apart: int = 1) -> IntArray:
        """Return the database frames that some frames of the sample represent.

        Args:
            least: Number of frames wanted, starting with those of the first sample frames; by default all.
            apart: Step between the frames that are returned.
        """
        chosen = frames[: -(-least // self.step)] if least else frames
        before, after = self.step // 2 // apart, -(-(self.step - self.step // 2) // apart)
        found = (chosen[:, None] + apart * np.arange(-before, after)).ravel()
        return found[(found >= 0) & (found < self._frames)]
