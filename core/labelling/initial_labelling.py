"""Labels of points without a past: at the start, and after the body was lost.

Torso markers keep their distances from each other in every pose, so the few ways in which points can be the torso are
enumerated. Each places the root. In its frame every pair of limb markers is compared with poses of the database: two
arms and two legs may all be known, though never seen together.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from .torso_candidates import FEWEST, MISSED_COST, Search, TorsoCandidates

_COARSE = 8  # every so many examples are enough to choose between placements of the root
_FITTED = 400  # torsos that are fitted,
_PLACED = 24  # of these, compared with some examples,
_COMPARED = 8  # and of these, compared with all and completed by limbs
_LABELLINGS = 40  # of the limbs, kept while they are completed
_BEST = 6  # of each torso
_LIMB_POINTS = 12  # that are tried for each limb
_MARGIN_M = 0.3  # beyond the farthest limb of all examples, where a point is no limb
_FEWEST_FOUND = 0.6  # share of the markers that must be found
REACH_M = 0.30  # from the closest example, within which a point may be a marker

# costs are minus logarithms of likelihoods
_TORSO_SIGMA_M = 0.05  # of a torso marker about the examples'
_UP_SIGMA_RAD = 0.25  # of the vertical
_UP_TAIL = 2.0  # who stands on the hands does so unlike any example; smaller is wider
_LIMB_SIGMA_M = 0.1  # of a limb marker about the examples'
_MISSED_LIMB_COST = 6.0
_GHOST_COST = 4.0  # of a point that is no marker
_HOPELESS = 15.0  # above the cheapest torso: such a torso is not completed
_HOPELESS_SUM = 6.0  # above the cheapest labels, limbs included
_BACK_COST = 6.0  # of facing away from the cameras: many a crouch is also somebody who looks the other way
_ALIKE_RAD = 0.4  # between verticals of poses with limbs alike
_UNLIKE_WEIGHT = 0.02  # of other examples
_LEAST_LIKELIHOOD = 1e-9  # of a pair of limbs
_UNLIKELY = 3.6  # cost of each marker found, above which points are no body


@dataclass(frozen=True)
class InitialLabels:
    """Labels of points without a past.

    Args:
        labels: (N,) marker of each point, -1 for none.
        cost: minus the logarithm of their likelihood, up to a constant.
        expected_m: (M, 3) the markers of the closest example, where the body stands.
        rivals: other labels (N,) and their costs, the likeliest first.
    """

    labels: IntArray
    cost: float
    expected_m: Array
    rivals: tuple[tuple[IntArray, float], ...]


@dataclass(frozen=True)
class _Placement:
    """The root under one choice of the torso: points (T,), turn, shift, and the cost."""

    torso: IntArray
    turn: Array
    shift: Array
    cost: float = 0.0


class _Found(NamedTuple):
    """Labels (N,) of all points, with the torso from a placement."""

    cost: float
    labels: IntArray
    placement: _Placement


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
        own = np.ascontiguousarray(self._examples[:, self._torso])
        self._torsos = TorsoCandidates(own)
        self._torso_places, self._mean_torso = own, own.mean(axis=0, dtype=np.float64)
        self._limb_places = np.ascontiguousarray(self._examples[:, self._limbs].transpose(1, 0, 2))
        norms = np.einsum("lsc,lsc->ls", self._limb_places, self._limb_places)
        self._limb_norms = norms
        self._reach_m = float(np.sqrt(norms.max(initial=0.0))) + _MARGIN_M

    def label(self, points_m: Array) -> InitialLabels | None:
        """Return labels of points (N, 3), y up; None if they look like no body."""
        search = self.search(points_m)
        while True:
            try:
                next(search)
            except StopIteration as end:
                found: InitialLabels | None = end.value
                return found

    def search(self, points_m: Array) -> Search[InitialLabels | None]:
        """Do the same as `label`, in pieces."""
        torsos = yield from self._torsos.choose(points_m)
        if len(torsos) == 0:
            return None
        placements = self._place_roughly(points_m, torsos[:_FITTED])
        yield 5.0 * _PLACED * self._torso_places[::_COARSE].size + 500.0 * len(torsos[:_FITTED])
        found: list[_Found] = []
        for placement in placements:
            least = min((each.cost for each in found), default=np.inf)
            if placement.cost < min(placements[0].cost + _HOPELESS, least + _HOPELESS_SUM):
                found += self._label_limbs(points_m, placement)
                yield 50.0 * len(self._examples) * len(self._limbs)
        result = self._result(points_m, found)
        count, markers = int(np.sum(result.labels >= 0)), self._examples.shape[1]
        cost = result.cost - _GHOST_COST * (len(points_m) - count) - _MISSED_LIMB_COST * (markers - count)
        return result if cost < _UNLIKELY * count and count >= _FEWEST_FOUND * markers else None

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
        if np.sum(torso >= 0) < FEWEST:
            if followed_m is None:
                return float("inf")
            placing, torso = np.where(seen[:, None], markers_m, followed_m), self._torso
        turns, shifts, _ = _fit_torsos(self._mean_torso, placing, torso[None])
        placement = self._place(placing, _Placement(torso, turns[0], shifts[0]))
        found = seen[self._limbs]
        own = np.where(found, self._limbs, -1)[:, None]
        pairs = self._pair_costs(_to_local(markers_m, placement), own, placement)
        column = np.where(found, 0, 1)
        rows = np.arange(len(found))
        chosen = pairs[rows[:, None], column[:, None], rows[None], column[None]]
        limbs = float(np.sum(np.triu(chosen, 1))) / max(len(found) - 1, 1)
        return placement.cost + limbs + _MISSED_LIMB_COST * float(np.sum(~found)) + _GHOST_COST * ghosts

    def _place_roughly(self, points_m: Array, torsos: IntArray) -> list[_Placement]:
        """Return the likeliest placements of the root, with their costs."""
        turns, shifts, errors = _fit_torsos(self._mean_torso, points_m, torsos)
        missing = torsos < 0
        rough = errors / (2.0 * _TORSO_SIGMA_M**2) + MISSED_COST * missing.sum(axis=1)
        rough += _BACK_COST * 0.5 * (1.0 - turns[:, 2, 2])
        rows = np.argsort(rough, kind="stable")[:_PLACED]
        placements = [_Placement(torsos[row], turns[row], shifts[row]) for row in rows]
        coarse = [self._place(points_m, placement, _COARSE).cost for placement in placements]
        best = np.argsort(coarse, kind="stable")[:_COMPARED]
        return sorted((self._place(points_m, placements[row]) for row in best), key=lambda placed: placed.cost)

    def _place(self, points_m: Array, placement: _Placement, step: int = 1) -> _Placement:
        """Return a placement with the cost of the torso against every `step`th example."""
        torso, turn = placement.torso, placement.turn
        cost = float(self._torso_costs(points_m, placement, step).min())
        cost += MISSED_COST * float(np.sum(torso < 0)) + _BACK_COST * 0.5 * (1.0 - turn[2, 2])
        return _Placement(torso, turn, placement.shift, cost)

    def _torso_costs(self, points_m: Array, placement: _Placement, step: int = 1) -> FloatArray:
        """Return the cost of the torso's places and of the vertical against examples (S,)."""
        seen = placement.torso >= 0
        away = self._torso_places[::step, seen] - _to_local(points_m[placement.torso[seen]], placement)
        costs = np.einsum("smc,smc->s", away, away) / np.float32(2.0 * _TORSO_SIGMA_M**2)
        tilt = 1.0 - self._ups[::step] @ placement.turn[1].astype(np.float32)
        costs += _UP_TAIL * np.log1p(np.maximum(tilt, 0.0) * np.float32(1.0 / (_UP_TAIL * _UP_SIGMA_RAD**2)))
        return np.asarray(costs, dtype=np.float32)

    def _label_limbs(self, points_m: Array, placement: _Placement) -> list[_Found]:
        """Label the points that are not the torso by pairs of limbs, the likeliest first."""
        torso = placement.torso
        local = _to_local(points_m, placement)
        is_free = np.einsum("nc,nc->n", local, local) < self._reach_m**2
        is_free[torso[torso >= 0]] = False
        candidates = self._limb_candidates(local, np.flatnonzero(is_free))
        choices, costs = _cheapest(self._pair_costs(local, candidates, placement), candidates)
        result = []
        for choice, cost in zip(choices, costs, strict=True):
            labels = np.full(len(points_m), -1, dtype=np.int64)
            labels[torso[torso >= 0]] = self._torso[torso >= 0]
            labels[choice[choice >= 0]] = self._limbs[choice >= 0]
            cost += placement.cost + _MISSED_LIMB_COST * np.sum(choice < 0) + _GHOST_COST * np.sum(labels < 0)
            result.append(_Found(float(cost), labels, placement))
        return result

    def _result(self, points_m: Array, found: list[_Found]) -> InitialLabels:
        """Return the likeliest labels with where the closest example has the markers."""
        found = sorted(found, key=lambda each: each.cost)[:_BEST]
        cost, labels, placement = found[0]
        seen = labels >= 0
        away = self._examples[:, labels[seen]] - _to_local(points_m[seen], placement)
        markers = self._examples[int(np.argmin(np.einsum("smc,smc->s", away, away)))].astype(np.float64)
        turns, shifts, _ = _fit_torsos(markers[self._torso], points_m, placement.torso[None])
        rivals = tuple((other.labels, other.cost) for other in found[1:])
        return InitialLabels(labels, cost, np.asarray(markers @ turns[0].T + shifts[0]), rivals)

    def _limb_candidates(self, local: FloatArray, free: IntArray) -> IntArray:
        """Return the points (L, C) that may be each limb, the likeliest of many."""
        limbs = len(self._limbs)
        if len(free) <= _LIMB_POINTS:
            return np.repeat(free[None], limbs, axis=0)
        likelihoods = [_likelihoods(places[::_COARSE], norms[::_COARSE], local[free]).sum(axis=0)
                       for places, norms in zip(self._limb_places, self._limb_norms, strict=True)]  # fmt: skip
        return free[np.argsort(likelihoods, axis=1)[:, : -_LIMB_POINTS - 1 : -1]]

    def _pair_costs(self, local: FloatArray, candidates: IntArray, placement: _Placement) -> FloatArray:
        """Return the `pairs` of `_cheapest` for points in a placement's frame."""
        limbs, count = candidates.shape
        likelihoods = np.ones((limbs, count + 1, len(self._examples)), dtype=np.float32)
        for limb, own in enumerate(candidates):
            likelihoods[limb, :count] = _likelihoods(self._limb_places[limb], self._limb_norms[limb], local[own]).T
        flat = likelihoods.reshape(-1, len(self._examples))
        # examples with another vertical say less
        tilt = self._ups @ placement.turn[1].astype(np.float32)
        weights = np.exp((tilt - 1.0) / np.float32(_ALIKE_RAD**2)) + np.float32(_UNLIKE_WEIGHT)
        costs = -np.log((flat * (weights / weights.sum())) @ flat.T + np.float32(_LEAST_LIKELIHOOD))
        return np.asarray(costs.reshape(limbs, count + 1, limbs, count + 1), dtype=np.float32)


def _likelihoods(places: FloatArray, norms: FloatArray, points: FloatArray) -> FloatArray:
    """Return the heavy-tailed likelihoods (S, N) of points by places of examples."""
    away = norms[:, None] + np.einsum("nc,nc->n", points, points) - 2.0 * (places @ points.T)
    far = 1.0 / (1.0 + np.maximum(away, 0.0) * np.float32(1.0 / (8.0 * _LIMB_SIGMA_M**2)))
    far *= far
    return np.asarray(far * far, dtype=np.float32)


def _cheapest(pairs: FloatArray, candidates: IntArray) -> tuple[IntArray, Array]:
    """Return the cheapest points (K, L) of the limbs, -1 for none, and costs (K,).

    Args:
        pairs: (L, C + 1, L, C + 1) costs of two limbs at two of their candidates; the last stands for none.
        candidates: (L, C) points.
    """
    limbs, none = candidates.shape
    points = np.column_stack((candidates, np.full(limbs, -1)))
    chosen, costs = np.empty((1, 0), dtype=np.int64), np.zeros(1)
    for limb in range(limbs):
        earlier = np.arange(limb)
        taken = points[earlier, chosen][:, None] == points[limb][:, None]
        fits = ~np.any(taken & (points[limb] >= 0)[:, None], axis=2)
        cost = costs[:, None] + pairs[earlier, chosen, limb].sum(axis=1) / max(limbs - 1, 1)
        # a limb without a point leaves a point without a limb
        cost[:, none] += _MISSED_LIMB_COST + _GHOST_COST
        parent, column = np.nonzero(fits)
        best = np.argsort(cost[parent, column], kind="stable")[:_LABELLINGS]
        chosen = np.column_stack((chosen[parent[best]], column[best]))
        costs = cost[parent[best], column[best]]
    chosen, costs = chosen[:_BEST], costs[:_BEST]
    rows = points[np.arange(limbs), chosen]
    return rows, costs - (_MISSED_LIMB_COST + _GHOST_COST) * np.sum(rows < 0, axis=1)


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
