"""Choice of points for all limb markers of a body, from the costs of pairs."""

from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray
from ..kernel.library import address, checked, contiguous, function, stage


class ChoiceLimits(NamedTuple):
    """How many choices are kept, and what a hidden marker costs."""

    kept: int  # while markers are added
    best: int  # in the end, of each placement
    hidden_cost: float  # for a choice to be kept: a hidden limb marker also leaves a point unlabelled


_CHOOSE = function("cheapest_choices", "pdppppppp")


def _compiled(pairs: FloatArray, candidates: IntArray, limits: ChoiceLimits) -> tuple[IntArray, Array]:
    placements, limbs, none = candidates.shape
    most, found = limits.kept * (none + 1), limits.kept
    sizes = np.array([placements, limbs, none, limits.kept, limits.best])
    among, work = np.empty((most, 2)), np.empty(4 * found * max(limbs, 1), dtype=np.int64)
    rows, costs = np.empty((placements, limits.best, limbs), dtype=np.int64), np.empty((placements, limits.best))
    count = np.zeros(1, dtype=np.int64)
    given = contiguous(pairs, np.float32), contiguous(candidates, np.int64)
    arrays = map(address, (among, work, rows, costs, count))
    checked(_CHOOSE(address(sizes), limits.hidden_cost, *given, *arrays))
    return rows[:, : count[0]], costs[:, : count[0]]


@stage(_compiled)
def cheapest_choices(pairs: FloatArray, candidates: IntArray, limits: ChoiceLimits) -> tuple[IntArray, Array]:
    """Return the K cheapest choices (P, K, L) of points for limb markers, -1 for none, and their costs (P, K).

    Markers are added one by one, and only the cheapest choices are kept each time (beam search).

    Args:
        pairs: Costs (P, L, C + 1, L, C + 1) of two limb markers at two of their candidates; the last candidate means
            that the marker is hidden.
        candidates: Points (P, L, C) of each placement, padded with -1.
    """
    placements, limbs, none = candidates.shape
    every = np.arange(placements)[:, None, None]
    chosen, rows = np.empty((2, placements, 1, 0), dtype=np.int64)
    costs = np.zeros((placements, 1))
    for limb in range(limbs):
        own = np.column_stack((candidates[:, limb], np.full(placements, -1)))
        cost = costs[:, :, None] + pairs[every, np.arange(limb), chosen, limb].sum(axis=2) / max(limbs - 1, 1)
        cost[:, :, none] += limits.hidden_cost
        taken = np.any(rows[:, :, None] == own[:, None, :, None], axis=3) | (own < 0)[:, None]
        cost[:, :, :none][taken[:, :, :none]] = np.inf
        flat = cost.reshape(placements, -1)
        best = np.argsort(flat, axis=1, kind="stable")[:, : limits.kept]
        parent, column = best // (none + 1), best % (none + 1)
        chosen = np.concatenate((chosen[every[..., 0], parent], column[..., None]), axis=2)
        rows = np.concatenate((rows[every[..., 0], parent], own[every[..., 0], column][..., None]), axis=2)
        costs = np.take_along_axis(flat, best, axis=1)
    rows, costs = rows[:, : limits.best], costs[:, : limits.best]
    return rows, costs - limits.hidden_cost * np.sum(rows < 0, axis=2)
