"""Neighbour graph that large databases of earlier versions hold (Eq. 4 of Chai and Hodgins 2005)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class NeighbourGraph:
    """Neighbours and clusters of all frames.

    Args:
        neighbours: (F, N) int32 frame indices, -1 where there are fewer.
        clusters: (F,) int32 cluster of each frame, all from 0 up to the largest in use.
    """

    neighbours: NDArray[np.int32]
    clusters: NDArray[np.int32]
