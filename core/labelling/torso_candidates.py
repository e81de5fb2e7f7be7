"""Candidate points for the torso markers, whose distances from each other hardly change."""

from collections.abc import Generator, Mapping
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray
from ..markers.marker_set import FEWEST_TORSO


@dataclass(frozen=True)
class TorsoSettings:
    """Settings of `TorsoCandidates`; costs are negative log likelihoods."""

    missed_cost: float = 6.0  # cost of a torso marker without a point
    percentiles: tuple[float, float] = (0.5, 99.5)  # percentiles of the examples' distances that limit those of a torso
    stretch: float = 0.1  # relative tolerance beyond these limits
    stretch_m: float = 0.03  # additional tolerance
    sigma_m: float = 0.05  # smallest standard deviation of a distance
    choices: int = 4000  # largest number of choices that are kept
    chunk: int = 200_000  # number of costs computed in one step of work


TORSO = TorsoSettings()

Found = TypeVar("Found")
Search: TypeAlias = Generator[float, None, Found]  # work in steps; yields the number of array elements handled


class TorsoCandidates:
    """Choices of points for the torso markers.

    Args:
        examples_m: Torso markers (S, T, 3) of poses.
    """

    def __init__(self, examples_m: FloatArray) -> None:
        own = np.asarray(examples_m, dtype=np.float64)
        spans = np.linalg.norm(own[:, :, None] - own[:, None], axis=-1)
        low, high = np.percentile(spans, TORSO.percentiles, axis=0)
        self._least_m = low * (1.0 - TORSO.stretch) - TORSO.stretch_m
        self._most_m = high * (1.0 + TORSO.stretch) + TORSO.stretch_m
        self._mean_m, self._sigma_m = spans.mean(axis=0), np.maximum(spans.std(axis=0), TORSO.sigma_m)

    def choose(self, points_m: Array) -> Search[IntArray]:
        """Return points (H, T) for the torso markers, or -1 for none, likeliest first."""
        points = len(points_m)
        costs = yield from self._span_costs(points_m)
        chosen, cost = np.empty((1, 0), dtype=np.int64), np.zeros(1, dtype=np.float32)
        for marker in range(len(self._mean_m)):
            missing = np.sum(chosen < 0, axis=1) < len(self._mean_m) - FEWEST_TORSO
            found = [np.column_stack((chosen, np.full(len(chosen), -1)))[missing]]
            found_costs = [cost[missing] + np.float32(TORSO.missed_cost)]
            size = max(TORSO.chunk // max(points, 1), 1)
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
            if len(chosen) > TORSO.choices:
                kept = np.argpartition(cost, TORSO.choices)[: TORSO.choices]
                chosen, cost = chosen[kept], cost[kept]
        return chosen[np.argsort(cost, kind="stable")]

    def _span_costs(self, points_m: Array) -> Search[Mapping[tuple[int, int], FloatArray]]:
        """Return the costs (N + 1, N) of two points for each pair of markers; in the last row the first is hidden."""
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
