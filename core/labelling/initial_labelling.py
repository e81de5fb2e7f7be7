"""Labelling points without history: at the start, and after the body was lost.

The distances between torso markers hardly change with the pose, so the few possible choices of points for the torso can
be enumerated. Each choice determines the root. In the root's frame, limb markers are compared with poses in the
database pair by pair, because arms and legs may each be in known poses that never occur together.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from ..markers.marker_set import FEWEST_TORSO
from .limb_choices import ChoiceLimits, cheapest_choices
from .torso_candidates import TORSO, Search, TorsoCandidates

REACH_M = 0.30  # distance from a marker of the closest example up to which a point may be that marker


@dataclass(frozen=True)
class InitialSettings:
    """Settings of `InitialLabeller`, tuned on cuts to random frames; costs are negative log likelihoods."""

    coarse: int = 8  # step between the examples used to choose between placements of the root
    fitted: int = 400  # number of choices of torso points to which the mean torso is fitted
    placed: int = 24  # number of these that are compared with the coarse examples
    compared: int = 8  # number of these that are compared with all examples and completed with limbs
    together: int = 10_500  # limit on examples times limb markers compared at once, so that live frames are in time
    labellings: int = 40  # number of labellings kept while limbs are added
    best: int = 6  # number of labellings kept for each torso
    limb_points: int = 12  # number of points tried for each limb marker
    margin_m: float = 0.3  # margin around the limbs of all examples; a point outside is not on a limb
    fewest_found: float = 0.6  # share of the markers that must be found
    unlikely: float = 3.6  # cost per marker found above which the points are not a body
    torso_sigma_m: float = 0.05  # standard deviation of a torso marker relative to the examples
    missed_torso_cost: float = TORSO.missed_cost
    up_sigma_rad: float = 0.25  # standard deviation of the up direction relative to the examples
    up_tail: float = 2.0  # heavy tail of the up direction, so that handstands stay possible; smaller is heavier
    limb_sigma_m: float = 0.1  # standard deviation of a limb marker relative to the examples
    missed_limb_cost: float = 6.0  # cost of a limb marker without a point
    ghost_cost: float = 4.0  # cost of a ghost: a point that is not a marker
    hopeless_torso: float = 15.0  # cost relative to the cheapest torso above which a torso is dropped
    hopeless: float = 6.0  # cost relative to the cheapest labelling above which a torso is dropped
    back_cost: float = 6.0  # cost of facing away from the cameras: many crouching poses also fit the opposite heading
    alike_rad: float = 0.4  # scale of the difference in up direction over which an example's weight falls
    unlike_weight: float = 0.02  # smallest weight of an example
    least_likelihood: float = 1e-9  # lower bound on the likelihood of a pair of limb markers


_S = InitialSettings()


@dataclass(frozen=True)
class InitialLabels:
    """Labels of N points, found without history."""

    labels: IntArray  # marker of each point, -1 for none
    cost: float  # negative log likelihood, up to a constant
    expected_m: Array  # (M, 3) markers of the closest example, at the body's position
    alternatives: tuple[tuple[IntArray, float], ...]  # alternative labels and their costs, likeliest first


class _Placement(NamedTuple):
    """Root determined by one choice of points (T,) for the torso."""

    torso: IntArray
    turn: Array
    shift: Array
    cost: float

    def to_local(self, points_m: Array) -> FloatArray:
        """Return points (N, 3) in the root's frame."""
        return np.asarray((points_m - self.shift) @ self.turn, dtype=np.float32)


class _Found(NamedTuple):
    """Labels (N,) of all points, with the torso of a placement."""

    cost: float
    labels: IntArray
    placement: _Placement


class InitialLabeller:
    """Labeller for a body in any pose similar to the examples, at any position and heading.

    Args:
        examples_m: Markers (S, M, 3) of poses in the root's frame.
        ups: Up direction (S, 3) of these poses in the same frame.
        torso: Markers (M,) on the torso, at least three.
    """

    def __init__(self, examples_m: FloatArray, ups: FloatArray, torso: Mask) -> None:
        self._examples = np.asarray(examples_m, dtype=np.float32)
        self._ups = np.asarray(ups, dtype=np.float32)
        self._torso, self._limbs = np.flatnonzero(torso), np.flatnonzero(~torso)
        own = np.ascontiguousarray(self._examples[:, self._torso])
        self._torsos = TorsoCandidates(own)
        self._torso_places, self._mean_torso = own, own.mean(axis=0, dtype=np.float64)
        self._limb_places = np.ascontiguousarray(self._examples[:, self._limbs].transpose(1, 2, 0))
        self._limb_norms = np.einsum("lcs,lcs->ls", self._limb_places, self._limb_places)
        self._reach_m = float(np.sqrt(self._limb_norms.max(initial=0.0))) + _S.margin_m

    def label(self, points_m: Array) -> InitialLabels | None:
        """Return labels of points (N, 3), y up; None if they do not look like a body."""
        search = self.search(points_m)
        try:
            while True:
                next(search)
        except StopIteration as end:
            found: InitialLabels | None = end.value
            return found

    def search(self, points_m: Array) -> Search[InitialLabels | None]:
        """Find the labels of `label` in steps of work."""
        torsos = yield from self._torsos.choose(points_m)
        if len(torsos) == 0:
            return None
        placements = self._place_roughly(points_m, torsos[: _S.fitted])
        yield 5.0 * _S.placed * self._torso_places[:: _S.coarse].size + 500.0 * len(torsos[: _S.fitted])
        found: list[_Found] = []
        examples = len(self._examples) * len(self._limbs)
        step = max(_S.together // max(examples, 1), 1)
        for first in range(0, len(placements), step):
            least = min((each.cost for each in found), default=np.inf)
            most = min(placements[0].cost + _S.hopeless_torso, least + _S.hopeless)
            together = [placement for placement in placements[first : first + step] if placement.cost < most]
            if together:
                found += self._label_limbs(points_m, together)
                yield 40.0 * len(together) * examples
        result = self._result(points_m, found)
        count, markers = int(np.sum(result.labels >= 0)), self._examples.shape[1]
        cost = result.cost - _S.ghost_cost * (len(points_m) - count) - _S.missed_limb_cost * (markers - count)
        return result if cost < _S.unlikely * count and count >= _S.fewest_found * markers else None

    def cost(self, markers_m: Array, followed_m: Array | None = None, ghosts: int = 0) -> float:
        """Return the cost of labelled markers, comparable with `InitialLabels.cost`.

        Args:
            markers_m: Markers (M, 3), NaN where hidden.
            followed_m: Markers (M, 3) of a tracked body, which determine its placement when too little of the torso is
                visible; without them the cost is then infinite.
            ghosts: Number of points that are not markers.
        """
        seen = np.all(np.isfinite(markers_m), axis=1)
        placing, torso = markers_m, np.where(seen[self._torso], self._torso, -1)
        if np.sum(torso >= 0) < FEWEST_TORSO:
            if followed_m is None:
                return float("inf")
            placing, torso = np.where(seen[:, None], markers_m, followed_m), self._torso
        turns, shifts, _ = _fit_torsos(self._mean_torso, placing, torso[None])
        placement = self._place(placing, torso[None], turns, shifts)[0]
        found = seen[self._limbs]
        own = np.where(found, self._limbs, -1)[:, None]
        pairs = self._pair_costs(placement.to_local(markers_m)[None], own[None], placement.turn[None])[0]
        column = np.where(found, 0, 1)
        rows = np.arange(len(found))
        chosen = pairs[rows[:, None], column[:, None], rows[None], column[None]]
        limbs = float(np.sum(np.triu(chosen, 1))) / max(len(found) - 1, 1)
        return placement.cost + limbs + _S.missed_limb_cost * float(np.sum(~found)) + _S.ghost_cost * ghosts

    def _place_roughly(self, points_m: Array, torsos: IntArray) -> list[_Placement]:
        """Return the likeliest placements for choices of torso points (H, T), cheapest first."""
        turns, shifts, errors = _fit_torsos(self._mean_torso, points_m, torsos)
        missing = torsos < 0
        rough = errors / (2.0 * _S.torso_sigma_m**2) + _S.missed_torso_cost * missing.sum(axis=1)
        rough += _S.back_cost * 0.5 * (1.0 - turns[:, 2, 2])
        rows = np.argsort(rough, kind="stable")[: _S.placed]
        coarse = self._place(points_m, torsos[rows], turns[rows], shifts[rows], _S.coarse)
        rows = rows[np.argsort([placed.cost for placed in coarse], kind="stable")[: _S.compared]]
        return sorted(self._place(points_m, torsos[rows], turns[rows], shifts[rows]), key=lambda placed: placed.cost)

    def _place(self, points_m: Array, torsos: IntArray, turns: Array, shifts: Array, step: int = 1) -> list[_Placement]:
        """Return placements with costs for choices of torso points (P, T) and their rotations and shifts.

        Torso and up direction are compared with every `step`th example.
        """
        seen = torsos >= 0
        places_m = np.where(seen[..., None], points_m[torsos] - shifts[:, None], 0.0)
        away = self._torso_places[None, ::step] - (places_m @ turns).astype(np.float32)[:, None]
        away *= away
        weights = np.repeat(seen * np.float32(0.5 / _S.torso_sigma_m**2), 3, axis=1)
        costs = (away.reshape(*away.shape[:2], -1) @ weights[..., None])[..., 0]
        tilt = 1.0 - turns[:, 1].astype(np.float32) @ self._ups[::step].T
        costs += _S.up_tail * np.log1p(np.maximum(tilt, 0.0) * np.float32(1.0 / (_S.up_tail * _S.up_sigma_rad**2)))
        least = costs.min(axis=1) + _S.missed_torso_cost * np.sum(torsos < 0, axis=1)
        least += _S.back_cost * 0.5 * (1.0 - turns[:, 2, 2])
        return [_Placement(*row) for row in zip(torsos, turns, shifts, least.tolist(), strict=True)]

    def _label_limbs(self, points_m: Array, placements: list[_Placement]) -> list[_Found]:
        """Label the remaining points by comparing pairs of limb markers with the examples."""
        local = np.stack([placement.to_local(points_m) for placement in placements])
        is_free = np.einsum("pnc,pnc->pn", local, local) < self._reach_m**2
        for row, placement in zip(is_free, placements, strict=True):
            row[placement.torso[placement.torso >= 0]] = False
        candidates = self._limb_candidates(local, is_free)
        turns = np.stack([placement.turn for placement in placements])
        limits = ChoiceLimits(_S.labellings, _S.best, _S.missed_limb_cost + _S.ghost_cost)
        choices, costs = cheapest_choices(self._pair_costs(local, candidates, turns), candidates, limits)
        # the additional last label is for hidden markers (index -1) and is cut off
        labels = np.full((*costs.shape, len(points_m) + 1), -1)
        torsos = np.stack([placement.torso for placement in placements])
        np.put_along_axis(labels, np.repeat(torsos[:, None], costs.shape[1], axis=1), self._torso, axis=2)
        np.put_along_axis(labels, choices, self._limbs, axis=2)
        labels = labels[..., :-1]
        costs += np.array([placement.cost for placement in placements])[:, None]
        costs += _S.missed_limb_cost * np.sum(choices < 0, axis=2) + _S.ghost_cost * np.sum(labels < 0, axis=2)
        return [
            _Found(float(cost), labels[row, column], placements[row])
            for (row, column), cost in np.ndenumerate(costs)
            if np.isfinite(cost)
        ]

    def _result(self, points_m: Array, found: list[_Found]) -> InitialLabels:
        """Return the likeliest labels, with alternatives and the markers of the closest example."""
        found = sorted(found, key=lambda each: each.cost)[: _S.best]
        cost, labels, placement = found[0]
        seen = labels >= 0
        away = self._examples[:, labels[seen]] - placement.to_local(points_m[seen])
        markers = self._examples[int(np.argmin(np.einsum("smc,smc->s", away, away)))].astype(np.float64)
        turns, shifts, _ = _fit_torsos(markers[self._torso], points_m, placement.torso[None])
        alternatives = tuple((other.labels, other.cost) for other in found[1:])
        return InitialLabels(labels, cost, np.asarray(markers @ turns[0].T + shifts[0]), alternatives)

    def _limb_candidates(self, local: FloatArray, is_free: Mask) -> IntArray:
        """Return the likeliest points (P, L, C) for each limb marker, padded with -1."""
        limbs = len(self._limbs)
        result = np.full((len(local), limbs, min(int(is_free.sum(axis=1).max()), _S.limb_points)), -1)
        for row, points, free in zip(result, local, is_free, strict=True):
            chosen = np.flatnonzero(free)[None]
            if chosen.size > _S.limb_points:
                places, norms = self._limb_places[..., :: _S.coarse], self._limb_norms[:, :: _S.coarse]
                near = _likelihoods(places, norms, points[chosen]).sum(axis=2)
                chosen = chosen[0][np.argsort(near, axis=1)[:, : -_S.limb_points - 1 : -1]]
            row[:, : chosen.shape[1]] = chosen
        return result

    def _pair_costs(self, local: FloatArray, candidates: IntArray, turns: Array) -> FloatArray:
        """Return the `pairs` for `cheapest_choices` from points (P, N, 3) in the placements' frames."""
        placements, limbs, count = candidates.shape
        likelihoods = np.ones((placements, limbs, count + 1, len(self._examples)), dtype=np.float32)
        own = local[np.arange(placements)[:, None, None], candidates]
        likelihoods[:, :, :count] = _likelihoods(self._limb_places, self._limb_norms, own)
        flat = likelihoods.reshape(placements, -1, len(self._examples))
        # examples with a different up direction have less weight
        tilt = turns[:, 1].astype(np.float32) @ self._ups.T
        weights = np.exp((tilt - 1.0) / np.float32(_S.alike_rad**2)) + np.float32(_S.unlike_weight)
        weights /= weights.sum(axis=1, keepdims=True)
        together = (flat * weights[:, None]) @ flat.swapaxes(1, 2)
        costs = -np.log(together + np.float32(_S.least_likelihood))
        return np.asarray(costs.reshape(placements, limbs, count + 1, limbs, count + 1), dtype=np.float32)


def _likelihoods(places: FloatArray, norms: FloatArray, points: FloatArray) -> FloatArray:
    """Return heavy-tailed likelihoods (..., L, N, S) of points (..., L or 1, N, 3).

    Args:
        places: Positions (L, 3, S) of each limb marker in the examples.
        norms: Squared lengths (L, S) of these positions.
    """
    far = points @ places  # further operations are done in place
    far *= np.float32(-2.0)
    far += norms[:, None]
    far += np.einsum("...c,...c->...", points, points)[..., None]
    np.maximum(far, 0.0, out=far)
    far *= np.float32(1.0 / (8.0 * _S.limb_sigma_m**2))
    far += np.float32(1.0)
    np.reciprocal(far, out=far)
    far *= far
    far *= far
    return np.asarray(far)


def _fit_torsos(torso_m: Array, points_m: Array, chosen: IntArray) -> tuple[Array, Array, Array]:
    """Fit a torso (T, 3) to choices (H, T) of points; return rotations, shifts and sums of squared errors."""
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
