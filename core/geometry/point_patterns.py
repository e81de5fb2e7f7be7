"""Matching of points to a rigid marker pattern by their distances."""

import numpy as np

from .arrays import Array, IntArray, Mask
from .rigid_transform import kabsch, transform

_MOST_WAYS = 2000


def match_rigid_pattern(
    points_m: Array, spans_m: Array, tolerances_m: Array, fewest: int, allowed: Mask | None = None
) -> IntArray:
    """Return (H, M) point indices of the markers, -1 for none; fullest first.

    Args:
        points_m: (N, 3).
        spans_m: (M, M) distances between the markers.
        tolerances_m: (N, N) by which the distance between two points may differ from that of their markers.
        fewest: markers that must have a point.
        allowed: (N, M) which point may be which marker; None: any.
    """
    count, most_missing = len(spans_m), len(spans_m) - fewest
    between = np.linalg.norm(points_m[:, None] - points_m[None], axis=-1)
    chosen = np.empty((1, 0), dtype=np.int64)
    for marker in range(count):
        parent, point = np.indices((len(chosen), len(points_m))).reshape(2, -1)
        fits = np.all(chosen[parent] != point[:, None], axis=1)
        if allowed is not None:
            fits &= allowed[point, marker]
        for before in range(marker):
            other = chosen[parent, before]
            near = np.abs(between[other, point] - spans_m[before, marker]) <= tolerances_m[other, point]
            fits &= near | (other < 0)
        taken = np.column_stack((chosen[parent[fits]], point[fits]))
        without = np.column_stack((chosen, np.full(len(chosen), -1)))
        chosen = np.concatenate((taken, without))
        missing = np.sum(chosen < 0, axis=1)
        order = np.argsort(missing, kind="stable")
        chosen = chosen[order[missing[order] <= most_missing]][:_MOST_WAYS]
    return chosen


def fit_rigid(markers_m: Array, points_m: Array) -> tuple[Array, Array, float]:
    """Fit markers (N, 3) rigidly to points (N, 3)."""
    turn, shift = kabsch(markers_m, points_m)
    off = points_m - transform(turn, shift, markers_m)
    return turn, shift, float(np.sqrt(np.mean(np.sum(off * off, axis=1))))


def planarity_m(points_m: Array) -> float:
    """Return the RMS distance of points (N, 3) from the line that is nearest to them."""
    sizes = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    return float(np.sqrt(np.sum(sizes[1:] ** 2) / len(points_m)))
