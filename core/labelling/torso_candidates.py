"""Choices of points for a torso, where markers keep their distances."""

from collections.abc import Generator, Mapping
from typing import TypeAlias, TypeVar

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray

FEWEST = 3  # torso markers, from which the root can be placed
MISSED_COST = 6.0  # of a torso marker without a point; minus the logarithm of a likelihood, as all costs
_STRETCH = 0.1  # share by which distances may lie outside those of the examples,
_STRETCH_M = 0.03  # and metres
_RANGE = (0.5, 99.5)  # percentiles of the examples' distances
_SIGMA_M = 0.05  # of the distances, at least
_WAYS = 4000  # to choose the torso, at most
_CHUNK = 200_000  # choices that are looked at in one piece of work

Found = TypeVar("Found")
Search: TypeAlias = Generator[float, None, Found]  # in pieces; each yields the array elements handled


class TorsoCandidates:
    """Choices of points for the torso markers.

    Args:
        examples_m: (S, T, 3) torso markers of poses.
    """

    def __init__(self, examples_m: FloatArray) -> None:
        own = np.asarray(examples_m, dtype=np.float64)
        spans = np.linalg.norm(own[:, :, None] - own[:, None], axis=-1)
        low, high = np.percentile(spans, _RANGE, axis=0)
        self._least_m, self._most_m = low * (1.0 - _STRETCH) - _STRETCH_M, high * (1.0 + _STRETCH) + _STRETCH_M
        self._mean_m, self._sigma_m = spans.mean(axis=0), np.maximum(spans.std(axis=0), _SIGMA_M)

    def choose(self, points_m: Array) -> Search[IntArray]:
        """Return points (H, T) of the torso markers, -1 for none, likeliest first."""
        points = len(points_m)
        costs = yield from self._span_costs(points_m)
        chosen, cost = np.empty((1, 0), dtype=np.int64), np.zeros(1, dtype=np.float32)
        for marker in range(len(self._mean_m)):
            missing = np.sum(chosen < 0, axis=1) < len(self._mean_m) - FEWEST
            found = [np.column_stack((chosen, np.full(len(chosen), -1)))[missing]]
            found_costs = [cost[missing] + np.float32(MISSED_COST)]
            size = max(_CHUNK // max(points, 1), 1)
            for first in range(0, len(chosen), size):
                part = chosen[first : first + size]
                table = np.repeat(cost[first : first + size, None], points, axis=1)
                for before in range(marker):
                    table += costs[before, marker][part[:, before]]
                parent, point = np.nonzero(np.isfinite(table))
                found.append(np.column_stack((part[parent], point)))
                found_costs.append(table[parent, point])
                yield float(table.size * (marker + 1))
            chosen, cost = np.concatenate(found), np.concatenate(found_costs)
            if len(chosen) > _WAYS:
                kept = np.argpartition(cost, _WAYS)[:_WAYS]
                chosen, cost = chosen[kept], cost[kept]
        return chosen[np.argsort(cost, kind="stable")]

    def _span_costs(self, points_m: Array) -> Search[Mapping[tuple[int, int], FloatArray]]:
        """Return the costs (N + 1, N) of markers at two points; last row: at one."""
        points = len(points_m)
        norms = np.einsum("nc,nc->n", points_m, points_m)
        squares = norms[:, None] + norms - 2.0 * (points_m @ points_m.T)
        spans = np.sqrt(np.maximum(squares, 0.0), dtype=np.float32)
        np.fill_diagonal(spans, np.inf)
        costs = {}
        for pair in zip(*np.triu_indices(len(self._mean_m), 1), strict=True):
            costs[pair] = np.zeros((points + 1, points), dtype=np.float32)
            costs[pair][:points] = 0.5 * ((spans - self._mean_m[pair]) / self._sigma_m[pair]) ** 2
            costs[pair][:points][(spans < self._least_m[pair]) | (spans > self._most_m[pair])] = np.inf
            yield 4.0 * spans.size
        return costs
