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
_TOGETHER = 10_500  # at once with so many examples of all limbs: fewer are overhead, and more too dear for a frame
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
        alternatives: other labels (N,) and their costs, the likeliest first.
    """

    labels: IntArray
    cost: float
    expected_m: Array
    alternatives: tuple[tuple[IntArray, float], ...]


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
        self._limb_places = np.ascontiguousarray(self._examples[:, self._limbs].transpose(1, 2, 0))
        norms = np.einsum("lcs,lcs->ls", self._limb_places, self._limb_places)
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
        examples = len(self._examples) * len(self._limbs)
        step = max(_TOGETHER // max(examples, 1), 1)
        for first in range(0, len(placements), step):
            least = min((each.cost for each in found), default=np.inf)
            most = min(placements[0].cost + _HOPELESS, least + _HOPELESS_SUM)
            together = [placement for placement in placements[first : first + step] if placement.cost < most]
            if together:
                found += self._label_limbs(points_m, together)
                yield 40.0 * len(together) * examples
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
        placement = self._place(placing, torso[None], turns, shifts)[0]
        found = seen[self._limbs]
        own = np.where(found, self._limbs, -1)[:, None]
        pairs = self._pair_costs(_to_local(markers_m, placement)[None], own[None], placement.turn[None])[0]
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
        coarse = self._place(points_m, torsos[rows], turns[rows], shifts[rows], _COARSE)
        rows = rows[np.argsort([placed.cost for placed in coarse], kind="stable")[:_COMPARED]]
        return sorted(self._place(points_m, torsos[rows], turns[rows], shifts[rows]), key=lambda placed: placed.cost)

    def _place(self, points_m: Array, torsos: IntArray, turns: Array, shifts: Array, step: int = 1) -> list[_Placement]:
        """Return placements by turns and shifts of torsos (P, T), with their costs.

        The torsos' places and the vertical are compared with every `step`th example.
        """
        seen = torsos >= 0
        places_m = np.where(seen[..., None], points_m[torsos] - shifts[:, None], 0.0)
        away = self._torso_places[None, ::step] - (places_m @ turns).astype(np.float32)[:, None]
        away *= away
        weights = np.repeat(seen * np.float32(0.5 / _TORSO_SIGMA_M**2), 3, axis=1)
        costs = (away.reshape(*away.shape[:2], -1) @ weights[..., None])[..., 0]
        tilt = 1.0 - turns[:, 1].astype(np.float32) @ self._ups[::step].T
        costs += _UP_TAIL * np.log1p(np.maximum(tilt, 0.0) * np.float32(1.0 / (_UP_TAIL * _UP_SIGMA_RAD**2)))
        least = costs.min(axis=1) + MISSED_COST * np.sum(torsos < 0, axis=1) + _BACK_COST * 0.5 * (1.0 - turns[:, 2, 2])
        return [_Placement(*row) for row in zip(torsos, turns, shifts, least.tolist(), strict=True)]

    def _label_limbs(self, points_m: Array, placements: list[_Placement]) -> list[_Found]:
        """Label the points that are not the torso by pairs of limbs."""
        local = np.stack([_to_local(points_m, placement) for placement in placements])
        is_free = np.einsum("pnc,pnc->pn", local, local) < self._reach_m**2
        for row, placement in zip(is_free, placements, strict=True):
            row[placement.torso[placement.torso >= 0]] = False
        candidates = self._limb_candidates(local, is_free)
        turns = np.stack([placement.turn for placement in placements])
        choices, costs = _cheapest(self._pair_costs(local, candidates, turns), candidates)
        # a last label, cut off, takes those of no point
        labels = np.full((*costs.shape, len(points_m) + 1), -1)
        torsos = np.stack([placement.torso for placement in placements])
        np.put_along_axis(labels, np.repeat(torsos[:, None], costs.shape[1], axis=1), self._torso, axis=2)
        np.put_along_axis(labels, choices, self._limbs, axis=2)
        labels = labels[..., :-1]
        costs += np.array([placement.cost for placement in placements])[:, None]
        costs += _MISSED_LIMB_COST * np.sum(choices < 0, axis=2) + _GHOST_COST * np.sum(labels < 0, axis=2)
        return [
            _Found(float(cost), labels[row, column], placements[row])
            for (row, column), cost in np.ndenumerate(costs)
            if np.isfinite(cost)
        ]

    def _result(self, points_m: Array, found: list[_Found]) -> InitialLabels:
        """Return the likeliest labels with where the closest example has the markers."""
        found = sorted(found, key=lambda each: each.cost)[:_BEST]
        cost, labels, placement = found[0]
        seen = labels >= 0
        away = self._examples[:, labels[seen]] - _to_local(points_m[seen], placement)
        markers = self._examples[int(np.argmin(np.einsum("smc,smc->s", away, away)))].astype(np.float64)
        turns, shifts, _ = _fit_torsos(markers[self._torso], points_m, placement.torso[None])
        alternatives = tuple((other.labels, other.cost) for other in found[1:])
        return InitialLabels(labels, cost, np.asarray(markers @ turns[0].T + shifts[0]), alternatives)

    def _limb_candidates(self, local: FloatArray, is_free: Mask) -> IntArray:
        """Return the likeliest points (P, L, C) of each limb, -1 where there are fewer."""
        limbs = len(self._limbs)
        result = np.full((len(local), limbs, min(int(is_free.sum(axis=1).max()), _LIMB_POINTS)), -1)
        for row, points, free in zip(result, local, is_free, strict=True):
            chosen = np.flatnonzero(free)[None]
            if chosen.size > _LIMB_POINTS:
                places, norms = self._limb_places[..., ::_COARSE], self._limb_norms[:, ::_COARSE]
                near = _likelihoods(places, norms, points[chosen]).sum(axis=2)
                chosen = chosen[0][np.argsort(near, axis=1)[:, : -_LIMB_POINTS - 1 : -1]]
            row[:, : chosen.shape[1]] = chosen
        return result

    def _pair_costs(self, local: FloatArray, candidates: IntArray, turns: Array) -> FloatArray:
        """Return the `pairs` of `_cheapest` for points in the frames of placements."""
        placements, limbs, count = candidates.shape
        likelihoods = np.ones((placements, limbs, count + 1, len(self._examples)), dtype=np.float32)
        own = local[np.arange(placements)[:, None, None], candidates]
        likelihoods[:, :, :count] = _likelihoods(self._limb_places, self._limb_norms, own)
        flat = likelihoods.reshape(placements, -1, len(self._examples))
        # examples with another vertical say less
        tilt = turns[:, 1].astype(np.float32) @ self._ups.T
        weights = np.exp((tilt - 1.0) / np.float32(_ALIKE_RAD**2)) + np.float32(_UNLIKE_WEIGHT)
        weights /= weights.sum(axis=1, keepdims=True)
        together = (flat * weights[:, None]) @ flat.swapaxes(1, 2)
        costs = -np.log(together + np.float32(_LEAST_LIKELIHOOD))
        return np.asarray(costs.reshape(placements, limbs, count + 1, limbs, count + 1), dtype=np.float32)


def _likelihoods(places: FloatArray, norms: FloatArray, points: FloatArray) -> FloatArray:
    """Return heavy-tailed likelihoods (..., L, N, S) of points (..., L or 1, N, 3).

    Args:
        places, norms: (L, 3, S) and (L, S) examples of each limb, and their squared lengths.
    """
    far = points @ places  # every further step is taken in place
    far *= np.float32(-2.0)
    far += norms[:, None]
    far += np.einsum("...c,...c->...", points, points)[..., None]
    np.maximum(far, 0.0, out=far)
    far *= np.float32(1.0 / (8.0 * _LIMB_SIGMA_M**2))
    far += np.float32(1.0)
    np.reciprocal(far, out=far)
    far *= far
    far *= far
    return np.asarray(far)


def _cheapest(pairs: FloatArray, candidates: IntArray) -> tuple[IntArray, Array]:
    """Return the cheapest points (P, K, L) of limbs, -1 for none, and costs (P, K).

    Costs are infinite where there are fewer.

    Args:
        pairs: (P, L, C + 1, L, C + 1) costs of two limbs at two of their candidates; the last stands for none.
        candidates: (P, L, C) points of each placement, -1 where there are fewer.
    """
    placements, limbs, none = candidates.shape
    every = np.arange(placements)[:, None, None]
    chosen, rows = np.empty((2, placements, 1, 0), dtype=np.int64)
    costs = np.zeros((placements, 1))
    for limb in range(limbs):
        own = np.column_stack((candidates[:, limb], np.full(placements, -1)))
        cost = costs[:, :, None] + pairs[every, np.arange(limb), chosen, limb].sum(axis=2) / max(limbs - 1, 1)
        # a limb without a point leaves a point without a limb
        cost[:, :, none] += _MISSED_LIMB_COST + _GHOST_COST
        taken = np.any(rows[:, :, None] == own[:, None, :, None], axis=3) | (own < 0)[:, None]
        cost[:, :, :none][taken[:, :, :none]] = np.inf
        flat = cost.reshape(placements, -1)
        best = np.argsort(flat, axis=1, kind="stable")[:, :_LABELLINGS]
        parent, column = best // (none + 1), best % (none + 1)
        chosen = np.concatenate((chosen[every[..., 0], parent], column[..., None]), axis=2)
        rows = np.concatenate((rows[every[..., 0], parent], own[every[..., 0], column][..., None]), axis=2)
        costs = np.take_along_axis(flat, best, axis=1)
    rows, costs = rows[:, :_BEST], costs[:, :_BEST]
    return rows, costs - (_MISSED_LIMB_COST + _GHOST_COST) * np.sum(rows < 0, axis=2)


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
