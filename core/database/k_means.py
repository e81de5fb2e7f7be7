"""Cluster centres of many points, by k-means on a sample."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import FloatArray

Map = Callable[..., Iterable[Any]]  # `map`, or an executor's


def clusters_of(points: FloatArray, count: int, mapped: Map = map) -> NDArray[np.int64]:
    """Return the cluster index (F,) of each point; there are about `count` clusters, none of them empty."""
    return np.unique(nearest_centres(points, centres_of(points, count, mapped), mapped), return_inverse=True)[1]


def centres_of(points: FloatArray, count: int, mapped: Map = map, per_centre: int = 24) -> FloatArray:
    """Return about `count` centres (C, D) of points (F, D), from a sample of `per_centre` points per centre."""
    random = np.random.default_rng(0)  # a fixed seed gives the same result every time
    size = min(len(points), count * per_centre)
    return k_means(points[np.sort(random.choice(len(points), size, replace=False))], count, mapped)[0]


def k_means(points: FloatArray, count: int, mapped: Map = map, rounds: int = 4) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return at most `count` centres (C, D) of non-empty clusters and the index (F,) of each point's nearest centre."""
    random = np.random.default_rng(0)  # a fixed seed gives the same result every time
    centres = points[random.choice(len(points), count, replace=False)]
    for _ in range(rounds):
        nearest = nearest_centres(points, centres, mapped)
        order = np.argsort(nearest, kind="stable")
        filled, starts = np.unique(nearest[order], return_index=True)
        counts = np.diff(np.append(starts, len(points)))
        centres[filled] = np.add.reduceat(points[order], starts, axis=0) / counts[:, None]
    used, nearest = np.unique(nearest_centres(points, centres, mapped), return_inverse=True)
    return centres[used], nearest.reshape(-1)


def nearest_centres(points: FloatArray, centres: FloatArray, mapped: Map = map, chunk: int = 512) -> NDArray[np.int64]:
    """Return the index (F,) of the centre nearest to each point.

    Args:
        chunk: Number of points compared at once, chosen so that their distances fit into the CPU's cache.
    """
    factors = np.concatenate((-2.0 * centres.T, np.einsum("cd,cd->c", centres, centres)[None]))

    def nearest(start: int) -> NDArray[np.int64]:
        some = points[start : start + chunk]
        # squared distances without the point's squared norm, which is the same for all centres
        return np.argmin(np.column_stack((some, np.ones(len(some), some.dtype))) @ factors, axis=1)

    return np.concatenate(list(mapped(nearest, range(0, len(points), chunk))))
