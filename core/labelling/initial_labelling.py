"""Labels of points without a past: at the start, and after the body was lost.

Torso markers keep their distances from each other in every pose, so the few ways in which points can be the torso are
enumerated. Each places the root, and the other points are then compared, in its frame, with poses of the database.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from ..geometry.gated_assignment import assign

_FEWEST_TORSO = 3  # from which the root can be placed
_STRETCH = 0.1  # share by which torso distances may lie outside those of the examples,
_STRETCH_M = 0.03  # and metres
_RANGE = (0.5, 99.5)  # percentiles of the examples' distances
MISSED_M = 0.30  # what a marker costs that no point comes closer to
_UP_M = 0.3  # metres that a radian between the verticals counts
_BACK_M = 0.3  # what it counts to face away from the cameras: many a crouch is also somebody who looks the other way
_TORSOS = 24  # ways to place the root that are compared with the examples
_EXAMPLES_EACH = 4  # closest to each of them, as one point may be near two limbs and be counted twice
_REFINED = 32  # pairs of the two that are labelled
_FARTHEST_M = 0.20  # RMS over the markers beyond which nothing is labelled
_FEWEST_FOUND = 0.6  # share of the markers that must be found
_MISSED_TORSO_M = 0.1  # what a torso marker costs that is taken for hidden
_TORSO_WEIGHT = (
    2.0  # of its own error: a limb may be a hand's breadth off every example, a torso is much the same in all
)
_WAYS = 4000  # to choose the torso, at most


@dataclass(frozen=True)
class InitialLabels:
    """Labels of points without a past.

    Args:
        labels: (N,) marker of each point, -1 for none.
        distance_m: RMS over the markers of the distance to the closest example; a missed marker counts 0.3 m, and so
            does facing away from the cameras.
        expected_m: (M, 3) the markers of that example, where the body stands.
    """

    labels: IntArray
    distance_m: float
    expected_m: Array


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
        self._torso = np.flatnonzero(torso)
        self._limbs = np.flatnonzero(~torso)
        limbs = self._examples[:, self._limbs]
        self._limb_norms = np.einsum("slc,slc->sl", limbs, limbs)
        self._limb_places = limbs.reshape(-1, 3)
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
        likely = np.argsort(errors + _MISSED_TORSO_M**2 * np.sum(torsos < 0, axis=1))[:_TORSOS]
        rough = [
            (cost, example, row)
            for row in likely
            for cost, example in self._closest_examples(points_m, turns[row], shifts[row], torsos[row])
        ]
        rough.sort()
        best, least = None, np.inf
        for _, example, row in rough[:_REFINED]:
            found = self._label_by_example(points_m, torsos[row], example)
            cost = found.distance_m**2 + _TORSO_WEIGHT * self._torso_error_m2(points_m, torsos[row], example)
            if cost < least:
                best, least = found, cost
        if best is None or best.distance_m > _FARTHEST_M:
            return None
        enough = np.sum(best.labels >= 0) >= _FEWEST_FOUND * self._examples.shape[1]
        return best if enough else None

    def complete(self, points_m: Array, labels: IntArray) -> InitialLabels | None:
        """Complete known torso labels (N,) of points (N, 3); None with too few."""
        torso = np.full(len(self._torso), -1)
        for index, marker in enumerate(self._torso):
            torso[index] = np.flatnonzero(labels == marker)[0] if np.any(labels == marker) else -1
        if np.sum(torso >= 0) < _FEWEST_TORSO:
            return None
        turns, shifts, _ = _fit_torsos(self._mean_torso, points_m, torso[None])
        closest = self._closest_examples(points_m, turns[0], shifts[0], torso)
        found = [self._label_by_example(points_m, torso, example) for _, example in closest]
        return min(found, key=lambda start: start.distance_m)

    def distance_m(self, markers_m: Array, followed_m: Array | None = None) -> float:
        """Return the RMS distance of markers to the closest example.

        Args:
            markers_m: (M, 3), NaN where unseen.
            followed_m: (M, 3) where a body that is followed has them, which places it when too few of the torso are
                seen; None for no such body: then all markers count as missed.
        """
        seen = np.all(np.isfinite(markers_m), axis=1)
        torso, placing = np.where(seen[self._torso], self._torso, -1), markers_m
        if np.sum(torso >= 0) < _FEWEST_TORSO:
            if followed_m is None:
                return MISSED_M
            torso, placing = self._torso, np.where(seen[:, None], markers_m, followed_m)
        turns, shifts, _ = _fit_torsos(self._mean_torso, placing, torso[None])
        local = ((markers_m[seen] - shifts[0]) @ turns[0]).astype(np.float32)
        squares = np.sum((self._examples[:, seen] - local) ** 2, axis=2)
        cost = squares.sum(axis=1) + _UP_M**2 * np.sum((self._ups - turns[0][1].astype(np.float32)) ** 2, axis=1)
        example = int(np.argmin(cost))
        return self._distance_m(placing, np.where(seen, np.arange(len(seen)), -1), torso, example)

    def _torsos(self, points_m: Array) -> IntArray:
        """Return candidate points (H, T) of the torso markers by distances; -1: none."""
        spans = np.linalg.norm(points_m[:, None] - points_m[None], axis=-1)
        count, points = len(self._torso), np.arange(len(points_m))
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
            order = np.argsort(missing, kind="stable")[:_WAYS]
            chosen = chosen[order[missing[order] <= count - _FEWEST_TORSO]]
        return chosen

    def _closest_examples(self, points_m: Array, turn: Array, shift: Array, torso: IntArray) -> list[tuple[float, int]]:
        """Return cost and index of the closest examples, limbs taken in any order."""
        local = ((points_m - shift) @ turn).astype(np.float32)
        up = turn[1].astype(np.float32)
        cost = _UP_M**2 * np.sum((self._ups - up) ** 2, axis=1)
        seen = torso >= 0
        own = self._examples[:, self._torso[seen]] - local[torso[seen]]
        cost += np.einsum("smc,smc->s", own, own)
        others = np.delete(local, torso[seen], axis=0)
        if len(others):
            nearest = np.minimum(self._limb_distances(others).min(axis=2), MISSED_M**2)
            # a point is one limb only: where there are fewer points than limbs, the rest of the limbs is missed
            nearest.sort(axis=1)
            nearest[:, len(others) :] = MISSED_M**2
            cost += nearest.sum(axis=1)
        cost += MISSED_M**2 * np.sum(~seen) + _turned_away(turn)
        best = np.argpartition(cost, min(_EXAMPLES_EACH, len(cost)) - 1)[:_EXAMPLES_EACH]
        return [(float(cost[example]), int(example)) for example in best]

    def _limb_distances(self, points_m: FloatArray) -> FloatArray:
        """Return the squared distances (S, L, N) from limb markers to local points."""
        products = (self._limb_places @ points_m.T).reshape(*self._limb_norms.shape, -1)
        return self._limb_norms[..., None] - 2.0 * products + np.einsum("nc,nc->n", points_m, points_m)

    def _label_by_example(self, points_m: Array, torso: IntArray, example: int) -> InitialLabels:
        """Label the other points by an example fitted to the chosen torso."""
        placed, _ = self._fit_example(points_m, torso, example)
        labels = np.full(len(points_m), -1, dtype=np.int64)
        labels[torso[torso >= 0]] = self._torso[torso >= 0]
        free = np.flatnonzero(labels < 0)
        distances = np.linalg.norm(points_m[free][:, None] - placed[self._limbs][None], axis=-1)
        rows, columns = assign(distances**2, MISSED_M**2)
        labels[free[rows]] = self._limbs[columns]
        return InitialLabels(labels, self._distance_m(points_m, labels, torso, example), placed)

    def _distance_m(self, points_m: Array, labels: IntArray, torso: IntArray, example: int) -> float:
        """Return `InitialLabels.distance_m` of labels against one fitted example."""
        placed, turn = self._fit_example(points_m, torso, example)
        squares = np.full(len(placed), MISSED_M**2)
        found = np.flatnonzero(labels >= 0)
        off = np.sum((points_m[found] - placed[labels[found]]) ** 2, axis=1)
        squares[labels[found]] = np.minimum(off, MISSED_M**2)
        tilt = _UP_M**2 * np.sum((self._ups[example] - turn[1]) ** 2)
        return float(np.sqrt((squares.sum() + tilt + _turned_away(turn)) / len(placed)))

    def _torso_error_m2(self, points_m: Array, torso: IntArray, example: int) -> float:
        """Return the mean squared distance of an example's torso to its points."""
        _, _, errors = _fit_torsos(self._examples[example, self._torso].astype(np.float64), points_m, torso[None])
        return float(errors[0]) / int(np.sum(torso >= 0))

    def _fit_example(self, points_m: Array, torso: IntArray, example: int) -> tuple[Array, Array]:
        """Return markers (M, 3) and turn of an example fitted to the chosen torso."""
        markers = self._examples[example].astype(np.float64)
        turns, shifts, _ = _fit_torsos(markers[self._torso], points_m, torso[None])
        return markers @ turns[0].T + shifts[0], turns[0]


def _turned_away(turn: Array) -> float:
    """Return the squared-distance cost of facing away from the cameras."""
    return float(_BACK_M**2 * 0.5 * (1.0 - turn[2, 2]))


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
