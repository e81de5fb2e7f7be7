"""Search in a sample of the database, every nth frame, for marker frames that must be solved quickly."""

import numpy as np
from numpy.typing import NDArray

from ...geometry.arrays import FloatArray, IntArray
from ...kernel.library import Packed, address, contiguous, function, stage
from ..database_markers import DatabaseMarkers
from .exhaustive import Query, closest

_FRAMES = 8192  # largest sample


class SampleSearch:
    """Search among a limited number of frames in a database of any size.

    Attributes:
        step: Number of database frames that each frame of the sample represents.
        rows: Stored markers (S, 3 M) of the sample, one after the other in memory.
        packed: The sample as the kernel takes it.
        visited: Number of distances computed so far.
    """

    def __init__(self, markers: DatabaseMarkers) -> None:
        self._frames, self.step = len(markers), -(-len(markers) // _FRAMES)
        rows = markers.rows.take(markers.places[:: self.step], axis=0)
        self.rows: NDArray[np.int16] = np.ascontiguousarray(rows[:, : 3 * markers.count])
        self.unit_m, self.visited = markers.unit_m, 0
        self.packed = Packed(*self.rows.shape, self.step, self.rows, float(self.unit_m))

    def __len__(self) -> int:
        return len(self.rows)

    def nearest(self, query: Query, count: int) -> IntArray:
        """Return the `count` closest frames of the sample, closest first, as indices of database frames."""
        self.visited += len(self)
        target, weights, _ = query.single_precision
        return nearest_in_sample(self, target, weights, min(count, len(self)))

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


_NEAREST = function("nearest_in_sample", "pppnp")


def _compiled(sample: SampleSearch, target: FloatArray, weights: FloatArray, count: int) -> IntArray:
    candidates = np.empty((4 * count, 2))
    wanted = contiguous(target, np.float32), contiguous(weights, np.float32), count
    found = _NEAREST(sample.packed.address, *wanted, address(candidates))
    return candidates.view(np.int64)[:found, 1].copy()


@stage(_compiled)
def nearest_in_sample(sample: SampleSearch, target: FloatArray, weights: FloatArray, count: int) -> IntArray:
    """Return the `count` > 0 frames of a sample that are closest to a target (3 M,) with weights (3 M,)."""
    away = sample.rows * sample.unit_m
    away -= target
    away *= away
    return sample.step * closest(away @ weights, count)[0]
