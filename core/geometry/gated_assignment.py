"""One-to-one assignment with an upper limit on the cost of each pair."""

import numpy as np
from numpy.typing import ArrayLike

from ..kernel.library import address, checked, contiguous, function, stage
from .arrays import Array, IntArray

_ASSIGN = function("assign", "nndppppp")


def _compiled(costs: ArrayLike, gate: float = 1.0) -> tuple[IntArray, IntArray]:
    table = np.asarray(costs, dtype=np.float64)
    rows, columns = table.shape
    pairs, count = np.empty((2, min(rows, columns)), dtype=np.int64), np.empty(1, dtype=np.int64)
    indices, values = np.empty(4 * (rows + columns), dtype=np.int64), np.empty(rows * columns + 2 * (rows + columns))
    work = address(indices), address(values)
    checked(_ASSIGN(rows, columns, gate, contiguous(table), *work, address(pairs), address(count)))
    found, among = pairs[:, : count[0]]
    return found, among


@stage(_compiled)
def assign(costs: ArrayLike, gate: float = 1.0) -> tuple[IntArray, IntArray]:
    """Return rows (K,) and columns (K,) of the cheapest one-to-one assignment.

    Pairs whose cost reaches the gate are left out.

    Args:
        costs: Costs (N, M), infinite where a pair is forbidden.
        gate: Positive limit of all costs; if limits differ between pairs, divide each cost by its limit first.

    Raises:
        LinAlgError: A cost is infinitely low, or sums of costs are.
    """
    table = np.asarray(costs, dtype=np.float64)
    allowed = table < gate
    rows, columns = np.flatnonzero(allowed.any(axis=1)), np.flatnonzero(allowed.any(axis=0))
    # what is forbidden costs as much as no pair at all
    kept = np.where(allowed, table, gate)[np.ix_(rows, columns)]
    if len(rows) <= len(columns):
        columns = columns[_cheapest_columns(kept)]
    else:
        rows = rows[_cheapest_columns(kept.T)]
        order = np.argsort(rows)
        rows, columns = rows[order], columns[order]
    inside = allowed[rows, columns]
    return rows[inside], columns[inside]


def _cheapest_columns(costs: Array) -> IntArray:
    """Return a different column (N,) for each row of costs (N, M), N <= M, with the smallest sum.

    Shortest augmenting paths (Crouse 2016), unless each row can have its cheapest column.

    Raises:
        LinAlgError: A cost is not finite, or sums of costs are not.
    """
    if not np.isfinite(costs).all():
        raise np.linalg.LinAlgError("a cost is not finite")
    count = costs.shape[1]
    found = costs.argmin(axis=1) if costs.size else np.zeros(0, dtype=np.int64)
    if len(np.unique(found)) == len(found):
        return found
    row_prices, column_prices, owners = np.zeros(len(costs)), np.zeros(count), np.full(count, -1)
    for row in range(len(costs)):
        shortest, path, is_done = np.full(count, np.inf), np.full(count, -1), np.zeros(count, dtype=np.bool_)
        at, least, visited = row, 0.0, [row]
        while True:
            lengths = least + costs[at] - row_prices[at] - column_prices
            better = ~is_done & (lengths < shortest)
            shortest[better], path[better] = lengths[better], at
            nearest = int(np.argmin(np.where(is_done, np.inf, shortest)))
            least = float(shortest[nearest])
            if not np.isfinite(least):
                raise np.linalg.LinAlgError("sums of costs are too large")
            is_done[nearest] = True
            if owners[nearest] < 0:
                break
            at = int(owners[nearest])
            visited.append(at)
        row_prices[row] += least
        others = visited[1:]
        row_prices[others] += least - shortest[found[others]]
        column_prices[is_done] -= least - shortest[is_done]
        at = -1
        while at != row:  # rows along the path move to the next column
            at = int(path[nearest])
            owners[nearest] = at
            found[at], nearest = nearest, int(found[at])
    return found
