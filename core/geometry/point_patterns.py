"""Rigid marker patterns: matching with points by distances, and fitting to points."""

import numpy as np

from .arrays import Array, IntArray, Mask
from .rigid_transform import kabsch, transform


def point_distances(points_m: Array, others_m: Array) -> Array:
    """Return the distances (N, M) between points (N, D) and others (M, D)."""
    squared = np.zeros((len(points_m), len(others_m)))
    for mine, theirs in zip(points_m.T, others_m.T, strict=True):  # no array (N, M, D) is needed
        squared += np.square(mine[:, None] - theirs)
    return np.sqrt(squared)


def match_rigid_pattern(
    points_m: Array, spans_m: Array, tolerances_m: Array, fewest: int, allowed: Mask | None = None
) -> IntArray:
    """Return matches (H, M), each with the point of every marker, or -1; matches with the most points come first.

    Args:
        points_m: Points (N, 3).
        spans_m: Distances (M, M) between the markers.
        tolerances_m: Largest difference (N, N) between the distance of two points and that of their markers.
        fewest: Smallest number of markers that must have a point.
        allowed: Mask (N, M) of the points to which each marker may be matched; None allows all.
    """
    if allowed is not None:
        rows = np.flatnonzero(allowed.any(axis=1))
        points_m, tolerances_m, allowed = points_m[rows], tolerances_m[np.ix_(rows, rows)], allowed[rows]
    between = point_distances(points_m, points_m)
    chosen = _extend_matches(between, spans_m, tolerances_m, len(spans_m) - fewest, allowed)
    return chosen if allowed is None else np.where(chosen >= 0, np.append(rows, -1)[chosen], -1)


def _extend_matches(
    between_m: Array, spans_m: Array, tolerances_m: Array, most_missing: int, allowed: Mask | None
) -> IntArray:
    """Return matches (H, M) with points at distances (N, N) from each other, extended marker by marker."""
    chosen = np.empty((1, 0), dtype=np.int64)
    for marker in range(len(spans_m)):
        fits = np.ones((len(chosen), len(between_m)), dtype=bool)
        if allowed is not None:
            fits &= allowed[:, marker]
        for before in range(marker):
            near = np.abs(between_m - spans_m[before, marker]) <= tolerances_m
            np.fill_diagonal(near, False)  # no point belongs to two markers
            # the last row, -1, represents a marker without a point
            fits &= np.concatenate((near, np.ones((1, len(near)), dtype=bool)))[chosen[:, before]]
        parent, point = np.nonzero(fits)
        taken = np.column_stack((chosen[parent], point))
        without = np.column_stack((chosen, np.full(len(chosen), -1)))
        chosen = np.concatenate((taken, without))
        missing = np.sum(chosen < 0, axis=1)
        order = np.argsort(missing, kind="stable")
        chosen = chosen[order[missing[order] <= most_missing]][:2000]  # limit on time and memory
    return chosen


def place_pattern(markers_m: Array, points_m: Array) -> tuple[Array, Array, float]:
    """Fit markers (N, 3) to points (N, 3); return rotation (3, 3), translation (3,) and RMS distance."""
    turn, shift = kabsch(markers_m, points_m)
    off = points_m - transform(turn, shift, markers_m)
    return turn, shift, float(np.sqrt(np.mean(np.sum(off * off, axis=1))))


def planarity_m(points_m: Array) -> float:
    """Return the RMS distance of points (N, 3) from the line that fits them best."""
    sizes = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    return float(np.sqrt(np.sum(sizes[1:] ** 2) / len(points_m)))
