"""Centres of clusters of very many points, by k-means."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import FloatArray

_SAMPLES_PER_CENTRE = 24  # points that a centre is learned from
_ROUNDS = 4
_CHUNK = 512  # points: their distances from all centres stay in the processor's cache


def clusters_of(points: FloatArray, count: int, mapped: Callable[..., Iterable[Any]] = map) -> NDArray[np.int64]:
    """Return the cluster (F,) of each point, of about `count`, none empty.

    Centres are learned from a sample.
    """
    return np.unique(nearest_centres(points, centres_of(points, count, mapped), mapped), return_inverse=True)[1]


def centres_of(points: FloatArray, count: int, mapped: Callable[..., Iterable[Any]] = map) -> FloatArray:
    """Return about `count` centres (C, D), learned from a sample of points (F, D)."""
    random = np.random.default_rng(0)  # the same every time
    size = min(len(points), count * _SAMPLES_PER_CENTRE)
    return k_means(points[np.sort(random.choice(len(points), size, replace=False))], count, mapped)[0]


def k_means(
    points: FloatArray, count: int, mapped: Callable[..., Iterable[Any]] = map
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return cluster centres (C, D) and the index (F,) of the closest to each point.

    Args:
        count: of centres to begin with; empty ones are dropped.
        mapped: `map`, or that of an executor.
    """
    random = np.random.default_rng(0)  # the same every time
    centres = points[random.choice(len(points), count, replace=False)]
    for _ in range(_ROUNDS):
        nearest = nearest_centres(points, centres, mapped)
        order = np.argsort(nearest, kind="stable")
        filled, starts = np.unique(nearest[order], return_index=True)
        counts = np.diff(np.append(starts, len(points)))
        centres[filled] = np.add.reduceat(points[order], starts, axis=0) / counts[:, None]
    used, nearest = np.unique(nearest_centres(points, centres, mapped), return_inverse=True)
    return centres[used], nearest.reshape(-1)


def nearest_centres(
    points: FloatArray, centres: FloatArray, mapped: Callable[..., Iterable[Any]] = map
) -> NDArray[np.int64]:
    """Return the index (F,) of the centre closest to each point."""
    factors = np.concatenate((-2.0 * centres.T, np.einsum("cd,cd->c", centres, centres)[None]))

    def nearest(start: int) -> NDArray[np.int64]:
        some = points[start : start + _CHUNK]
        # all but the square of the point, which all centres share
        return np.argmin(np.column_stack((some, np.ones(len(some), some.dtype))) @ factors, axis=1)

    return np.concatenate(list(mapped(nearest, range(0, len(points), _CHUNK))))
