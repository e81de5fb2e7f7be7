"""One-to-one assignment with a largest cost per pair."""

import numpy as np
from numpy.typing import ArrayLike

from .arrays import IntArray


def assign(costs: ArrayLike, gate: float = 1.0) -> tuple[IntArray, IntArray]:
    """Return rows (K,) and columns (K,) of the cheapest one-to-one assignment.

    A row or column left over costs the gate, and so does a pair at or above it: such pairs are not returned.

    Args:
        costs: (N, M); infinite where a pair is forbidden. Gates that differ between pairs: divide by them first.
            Distances are to be squared where least squares is meant.
        gate: positive.
    """
    # where nothing is assigned, scipy's slow import stays away
    from scipy.optimize import linear_sum_assignment

    table = np.asarray(costs, dtype=np.float64)
    rows, columns = linear_sum_assignment(np.minimum(table, gate))
    inside = table[rows, columns] < gate
    return rows[inside], columns[inside]
