"""One-to-one assignment with an upper limit on the cost of each pair."""

import numpy as np
from numpy.typing import ArrayLike

from .arrays import IntArray


def assign(costs: ArrayLike, gate: float = 1.0) -> tuple[IntArray, IntArray]:
    """Return rows (K,) and columns (K,) of the cheapest one-to-one assignment.

    Pairs whose cost reaches the gate are left out.

    Args:
        costs: Costs (N, M), infinite where a pair is forbidden.
        gate: Positive limit of all costs; if limits differ between pairs, divide each cost by its limit first.
    """
    # imported here, because SciPy is slow to import and Blender loads this module at startup
    from scipy.optimize import linear_sum_assignment

    table = np.asarray(costs, dtype=np.float64)
    rows, columns = linear_sum_assignment(np.minimum(table, gate))
    inside = table[rows, columns] < gate
    return rows[inside], columns[inside]
