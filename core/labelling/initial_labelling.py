"""Labels of points without a past: at the start, and after the body was lost.

Torso markers keep their distances from each other in every pose, so the few ways in which points can be the torso are
enumerated. Each places the root. In its frame the limb markers, as a whole and every pair of them, are compared
with poses of the database: two arms and two legs may all be known, though never seen together.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask

_FEWEST_TORSO = 3  # from which the root can be placed
_STRETCH = 0.1  # share by which torso distances may lie outside those of the examples,
_STRETCH_M = 0.03  # and metres
_RANGE = (0.5, 99.5)  # percentiles of the examples' distances
_TORSOS = 24  # ways to place the root that are compared with the examples,
_KEPT_TORSOS = 8  # and of these, completed by limbs
_WAYS = 4000  # to choose the torso, at most; fewer among many points
_WAYS_TIMES_POINTS = 120_000
_LABELLINGS = 100  # of the limbs, kept while they are completed,
_COMPARED = 20  # and of these, compared with whole examples
_WHOLE_SHARE = 0.5  # of the likelihood of all limbs at once against that of their pairs
_MARGIN_M = 0.3  # beyond the farthest limb of all examples, where a point is no limb
_PRODUCTS = 1e9  # multiplications for the pairs of limbs of one torso, at most: fewer examples for larger sets
_FEWEST_FOUND = 0.6  # share of the markers that must be found
REACH_M = 0.30  # from the closest example, within which a point may be a marker

# costs are minus logarithms of likelihoods
_TORSO_SIGMA_M = 0.05  # of a torso marker about the examples'
_UP_SIGMA_RAD = 0.25  # of the vertical
_LIMB_SIGMA_M = 0.08  # of a limb marker about the examples'
_MISSED_TORSO_COST = 6.0
_MISSED_LIMB_COST = 6.0
_GHOST_COST = 4.0  # of a point that is no marker
_HOPELESS = 15.0  # above the cheapest torso: such a torso is not completed
_BACK_COST = 6.0  # of facing away from the cameras: many a crouch is also somebody who looks the other way
_LEAST_LIKELIHOOD = 1e-9  # of a pair of limbs
_UNLIKELY = 50.0  # cost above which points are no body


@dataclass(frozen=True)
class InitialLabels:
    """Labels of points without a past.

    Args:
        labels: (N,) marker of each point, -1 for none.
        cost: minus the logarithm of their likelihood, up to a constant.
        expected_m: (M, 3) the markers of the closest example, where the body stands.
    """

    labels: IntArray
    cost: float
    expected_m: Array


@dataclass(frozen=True)
class _Placement:
    """The root under one choice of the torso: points (T,), turn, shift, and the cost."""

    torso: IntArray
    turn: Array
    shift: Array
    cost: float
    example_costs: FloatArray


class InitialLabeller:
    """Labeller of a body in any pose like the examples, at any place and heading.

    Args:
        examples_m: (S, M, 3) markers of poses in the root's frame.
        ups: (S, 3) the vertical in the same frame.
        torso: (M,) which markers lie on the torso, three at least.
    """

    def __init__(self, examples_m: FloatArray, ups: FloatArray, torso: Mask) -> None:
        self._examples = np.asarray(examples_m, dtype=np.float32)
        self._ups = np.asarray(ups, dtype=np.float32)
        self._torso, self._limbs = np.flatnonzero(torso), np.flatnonzero(~torso)
        self._limb_places = np.ascontiguousarray(self._examples[:, self._limbs])
        self._limb_norms = np.einsum("slc,slc->sl", self._limb_places, self._limb_places)
        self._reach_m = float(np.sqrt(self._limb_norms.max(initial=0.0))) + _MARGIN_M
        own = self._examples[:, self._torso].astype(np.float64)
        spans = np.linalg.norm(own[:, :, None] - own[:, None], axis=-1)
        low, high = np.percentile(spans, _RANGE, axis=0)
        self._least_m = low * (1.0 - _STRETCH) - _STRETCH_M
        self._most_m = high * (1.0 + _STRETCH) + _STRETCH_M
        self._mean_torso = own.mean(axis=0)

    def label(self, points_m: Array) -> InitialLabels | None:
        """Return the labels of points (N, 3), y up; None if they look like no body."""
        torsos = self._torsos(points_m)
        if len(torsos) == 0:
            return None
        turns, shifts, errors = _fit_torsos(self._mean_torso, points_m, torsos)
        rough = errors / (2.0 * _TORSO_SIGMA_M**2) + _MISSED_TORSO_COST * np.sum(torsos < 0, axis=1)
        placements = [
            self._place(points_m, torsos[row], turns[row], shifts[row]) for row in np.argsort(rough)[:_TORSOS]
        ]
        placements.sort(key=lambda placement: placement.cost)
        found = [
            self._label_limbs(points_m, placement)
            for placement in placements[:_KEPT_TORSOS]
            if placement.cost < placements[0].cost + _HOPELESS
        ]
        best = min(found, key=lambda labels: labels.cost)
        count = np.sum(best.labels >= 0)
        likely = best.cost < _UNLIKELY + _GHOST_COST * (len(points_m) - count)
        return best if likely and count >= _FEWEST_FOUND * self._examples.shape[1] else None

    def complete(self, points_m: Array, labels: IntArray) -> InitialLabels | None:
        """Complete known torso labels (N,) of points (N, 3); None with too few."""
        torso = np.full(len(self._torso), -1)
        for index, marker in enumerate(self._torso):
            torso[index] = np.flatnonzero(labels == marker)[0] if np.any(labels == marker) else -1
        if np.sum(torso >= 0) < _FEWEST_TORSO:
            return None
        turns, shifts, _ = _fit_torsos(self._mean_torso, points_m, torso[None])
        return self._label_limbs(points_m, self._place(points_m, torso, turns[0], shifts[0]))

    def cost(self, markers_m: Array, followed_m: Array | None = None, ghosts: int = 0) -> float:
        """Return the cost of labelled markers, as of `InitialLabels.cost`.

        Args:
            markers_m: (M, 3), NaN where unseen.
            ghosts: number of points that are no marker.
            followed_m: (M, 3) where a body that is followed has them, which places it when too few of the torso are
                seen; None for no such body: then the cost is infinite.
        """
        seen = np.all(np.isfinite(markers_m), axis=1)
        placing, torso = markers_m, np.where(seen[self._torso], self._torso, -1)
        if np.sum(torso >= 0) < _FEWEST_TORSO:
            if followed_m is None:
                return float("inf")
            placing, torso = np.where(seen[:, None], markers_m, followed_m), self._torso
        turns, shifts, _ = _fit_torsos(self._mean_torso, placing, torso[None])
        placement = self._place(placing, torso, turns[0], shifts[0])
        found = seen[self._limbs]
        likelihoods = np.ones((len(self._examples), len(found)), dtype=np.float32)
        local = _to_local(markers_m[self._limbs[found]], placement)
        away = np.sum((self._examples[:, self._limbs[found]] - local) ** 2, axis=2)
        likelihoods[:, found] = np.exp(-away / (2.0 * _LIMB_SIGMA_M**2))
        pairs = -np.log(likelihoods.T @ likelihoods / len(likelihoods) + _LEAST_LIKELIHOOD)
        limbs = float(np.sum(np.triu(pairs, 1))) / max(len(found) - 1, 1) + _whole_cost(likelihoods, found)
        return placement.cost + limbs + _MISSED_LIMB_COST * float(np.sum(~found)) + _GHOST_COST * ghosts

    def _torsos(self, points_m: Array) -> IntArray:
        """Return candidate points (H, T) of the torso markers by distances; -1: none."""
        spans = np.linalg.norm(points_m[:, None] - points_m[None], axis=-1)
        count, points = len(self._torso), np.arange(len(points_m))
        ways = min(_WAYS, _WAYS_TIMES_POINTS // max(len(points), 1))
        chosen = np.empty((1, 0), dtype=np.int64)
        for marker in range(count):
            # every partial choice continues with each point that is left and fits, and with none
            parent, point = np.indices((len(chosen), len(points_m))).reshape(2, -1)
            fits = np.all(chosen[parent] != point[:, None], axis=1)
            for before in range(marker):
                other = chosen[parent, before]
                span = spans[other, point]
                between = (span >= self._least_m[before, marker]) & (span <= self._most_m[before, marker])
                fits &= between | (other < 0)
            taken = np.column_stack((chosen[parent[fits]], points[point[fits]]))
            without = np.column_stack((chosen, np.full(len(chosen), -1)))
            chosen = np.concatenate((taken, without))
            missing = np.sum(chosen < 0, axis=1)
            order = np.argsort(missing, kind="stable")[:ways]
            chosen = chosen[order[missing[order] <= count - _FEWEST_TORSO]]
        return chosen

    def _place(self, points_m: Array, torso: IntArray, turn: Array, shift: Array) -> _Placement:
        """Return the root that a choice of the torso gives, with the cost of the torso."""
        placement = _Placement(torso, turn, shift, 0.0, np.empty(0, dtype=np.float32))
        seen = torso >= 0
        away = self._examples[:, self._torso[seen]] - _to_local(points_m[torso[seen]], placement)
        costs = np.einsum("smc,smc->s", away, away) / np.float32(2.0 * _TORSO_SIGMA_M**2)
        costs += np.sum((self._ups - turn[1].astype(np.float32)) ** 2, axis=1) / np.float32(2.0 * _UP_SIGMA_RAD**2)
        fixed = _MISSED_TORSO_COST * np.sum(~seen) + _BACK_COST * 0.5 * (1.0 - turn[2, 2])
        return _Placement(torso, turn, shift, float(costs.min() + fixed), costs)

    def _label_limbs(self, points_m: Array, placement: _Placement) -> InitialLabels:
        """Label the points that are not the torso by pairs of limbs."""
        torso = placement.torso
        within = np.linalg.norm(_to_local(points_m, placement), axis=1) < self._reach_m
        free = np.setdiff1d(np.flatnonzero(within), torso)
        count, limbs = len(free), len(self._limbs)
        step = int(np.ceil(len(self._examples) * (limbs * (count + 1)) ** 2 / _PRODUCTS))
        local = _to_local(points_m[free], placement)
        away = self._limb_norms[::step, :, None] + np.einsum("nc,nc->n", local, local)
        away -= 2.0 * (self._limb_places[::step].reshape(-1, 3) @ local.T).reshape(away.shape)
        # the last column stands for a limb without a point
        likelihoods = np.ones((len(away), limbs, count + 1), dtype=np.float32)
        likelihoods[:, :, :count] = np.exp(-away / np.float32(2.0 * _LIMB_SIGMA_M**2))
        flat = likelihoods.reshape(len(away), -1)
        pairs = -np.log(flat.T @ flat / np.float32(len(flat)) + np.float32(_LEAST_LIKELIHOOD))
        choices, costs = _cheapest(pairs.reshape(limbs, count + 1, limbs, count + 1))
        costs += [_whole_cost(likelihoods[:, np.arange(limbs), choice], choice < count) for choice in choices]
        chosen = choices[np.argmin(costs)]
        cost = float(np.min(costs) - _GHOST_COST * np.sum(chosen == count))
        labels = np.full(len(points_m), -1, dtype=np.int64)
        labels[torso[torso >= 0]] = self._torso[torso >= 0]
        labels[free[chosen[chosen < count]]] = self._limbs[chosen < count]
        found = np.flatnonzero(chosen < count)
        total = away[:, found, chosen[found]].sum(axis=1) / np.float32(2.0 * _LIMB_SIGMA_M**2)
        total += placement.example_costs[::step]
        cost += placement.cost + _GHOST_COST * float(np.sum(labels < 0))
        markers = self._examples[step * int(np.argmin(total))].astype(np.float64)
        turns, shifts, _ = _fit_torsos(markers[self._torso], points_m, torso[None])
        return InitialLabels(labels, float(cost), markers @ turns[0].T + shifts[0])


def _cheapest(pairs: FloatArray) -> tuple[IntArray, Array]:
    """Return the cheapest choices (K, L) of the limbs' points, and their costs (K,).

    Args:
        pairs: (L, N + 1, L, N + 1) cost of two limbs at two points; the last stands for none.
    """
    limbs, none = len(pairs), pairs.shape[1] - 1
    chosen, costs = np.empty((1, 0), dtype=np.int64), np.zeros(1)
    for limb in range(limbs):
        parent, point = np.indices((len(chosen), none + 1)).reshape(2, -1)
        free = (point == none) | np.all(chosen[parent] != point[:, None], axis=1)
        parent, point = parent[free], point[free]
        # a limb without a point leaves a point without a limb
        cost = costs[parent] + np.where(point == none, _MISSED_LIMB_COST + _GHOST_COST, 0.0)
        earlier = np.arange(limb)
        cost += pairs[earlier, chosen[parent], limb, point[:, None]].sum(axis=1) / max(limbs - 1, 1)
        best = np.argsort(cost, kind="stable")[:_LABELLINGS]
        chosen, costs = np.column_stack((chosen[parent[best]], point[best])), cost[best]
    return chosen[:_COMPARED], costs[:_COMPARED]


def _whole_cost(likelihoods: FloatArray, found: Mask) -> float:
    """Return the cost of all limbs (S, L) at once; it decides near an example."""
    likelihood = np.mean(np.prod(likelihoods, axis=1, dtype=np.float64)) if np.all(found) else 0.0
    return -_WHOLE_SHARE * float(np.log(likelihood + _LEAST_LIKELIHOOD))


def _to_local(points_m: Array, placement: _Placement) -> FloatArray:
    return np.asarray((points_m - placement.shift) @ placement.turn, dtype=np.float32)


def _fit_torsos(torso_m: Array, points_m: Array, chosen: IntArray) -> tuple[Array, Array, Array]:
    """Fit a torso (T, 3) to chosen points (H, T): turns, shifts, squared errors."""
    weights = (chosen >= 0).astype(np.float64)[..., None]
    weights /= weights.sum(axis=1, keepdims=True)
    targets = np.where(weights > 0.0, points_m[chosen], 0.0)
    source_mean = np.sum(weights * torso_m, axis=1, keepdims=True)
    target_mean = np.sum(weights * targets, axis=1, keepdims=True)
    source, target = torso_m - source_mean, (targets - target_mean) * (weights > 0.0)
    u, _, vt = np.linalg.svd(np.swapaxes(weights * source, 1, 2) @ target)
    signs = np.ones((len(chosen), 1, 3))
    signs[:, 0, 2] = np.sign(np.linalg.det(u @ vt))
    turns = np.swapaxes(u * signs @ vt, 1, 2)
    moved = source @ np.swapaxes(turns, 1, 2)
    shifts = target_mean[:, 0] - np.einsum("hij,hj->hi", turns, source_mean[:, 0])
    return turns, shifts, np.sum((weights > 0.0) * (moved - target) ** 2, axis=(1, 2))
