"""Correction of temporarily exchanged labels, by continuity and by distances on the body.

Labels of two markers are exchanged at a seam at which both trajectories jump and each continues where the other ends.
The most likely exchanged stretches of a take are found by the algorithm of Viterbi (1967), with further evidence from
the distances to other markers, which hardly change between markers of one bone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from .trajectory_seams import SeamScale, after, before, cost, sudden


@dataclass(frozen=True)
class ExchangeSettings:
    """Settings of `undo_exchanges`; chosen like `SeamSettings`."""

    jump_m: float = 0.03  # miss that each of the two trajectories must have at some seam (see `trajectory_seams`)
    jump_sigmas: float = 4.0  # the same, in standard deviations
    possible: float = 6.0  # evidence above which a seam is a candidate for an exchange, nats
    possible_in_gap: float = -3.0  # the same in a gap, where exchanges are frequent and leave little evidence
    gap: int = 3  # shortest step between two frames that show both markers, that is a gap, frames
    change: float = 9.0  # cost of each end of an exchange, nats
    change_in_gap: float = 6.0  # the same in a gap
    at_end: float = 9.0  # cost of labels that are exchanged at the take's beginning or end
    frame: float = 0.01  # cost of each frame with exchanged labels, nats: prefers the shorter of two explanations
    apart: int = 2  # number of seams on either side of a candidate that may show the same jump
    partners: int = 3  # number of other markers whose distances are compared
    rigid_m: float = 0.03  # largest standard deviation of a distance that is compared
    least_rigid_m: float = 0.01  # smallest standard deviation assumed, because of skin motion
    most_body: float = 15.0  # cap on the evidence from distances: labels of the other markers may be exchanged, too
    independent_s: float = 0.25  # time after which a distance is an independent measurement
    most: int = 200  # largest number of exchanges that are undone


_S = ExchangeSettings()


@dataclass(frozen=True)
class Exchange:
    """Frames `first` to `last`, inclusive, in which two markers (columns) had each other's labels."""

    first: int
    last: int
    markers: tuple[int, int]


def undo_exchanges(times_s: Array, points_m: Array, neighbours: Mask) -> tuple[Array, list[Exchange]]:
    """Return trajectories (F, M, 3) with exchanged labels corrected, and the list of exchanges.

    Args:
        times_s: Ascending times (F,).
        points_m: Trajectories (F, M, 3), NaN where hidden.
        neighbours: Mask (M, M) of pairs of markers on the same or on neighbouring bones.
    """
    search = _Search(times_s, points_m, neighbours)
    found: list[Exchange] = []
    while len(found) < _S.most and (best := search.best()):
        found += best
        search.put_back(best)
    return search.points_m, found


def put_back(points_m: Array, exchanges: Sequence[Exchange]) -> Array:
    """Return trajectories (F, M, 3) with exchanges undone, one after another."""
    points_m = points_m.copy()
    for each in exchanges:
        rows = slice(each.first, each.last + 1)
        points_m[rows, list(each.markers)] = points_m[rows, list(each.markers[::-1])]
    return points_m


@dataclass(frozen=True)
class _Course:
    """A trajectory at its seams.

    Args:
        path: Positions (F, 3), NaN where the marker is hidden.
        rows: Frames in which the marker is visible.
        ratios: Misses at the seams between these frames, relative to typical ones.
        come, go: Velocities (F, 3) before and after each frame, NaN where unknown.
        come_m: Positions (F - 1, 3) halfway to the next frame, extrapolated from earlier frames.
        misses_m2: Squared misses (F - 1,) between successive frames, NaN where unknown.
        jumps: Whether the trajectory jumps anywhere.
    """

    path: Array
    rows: IntArray
    ratios: Array
    come: Array
    go: Array
    come_m: Array
    misses_m2: Array
    jumps: bool


class _Search:
    """Finds the pair with the most evidence for exchanges, anew after each correction."""

    def __init__(self, times_s: Array, points_m: Array, neighbours: Mask) -> None:
        self._times_s, self.points_m = times_s, points_m
        self._scale = SeamScale(times_s, points_m)
        self._distances = RigidDistances(points_m, neighbours)
        self._frame_weight = float(np.median(np.diff(times_s))) / _S.independent_s
        markers = range(points_m.shape[1])
        self._courses = [self._course(marker) for marker in markers]
        self._found = {pair: self._exchanges(*pair) for pair in combinations(markers, 2) if self._worth(*pair)}

    def best(self) -> list[Exchange]:
        """Return the exchanges of the pair with the most evidence, or an empty list."""
        gains = {pair: gain for pair, (gain, _) in self._found.items() if gain > 0.0}
        return self._found[max(gains, key=gains.__getitem__)][1] if gains else []

    def put_back(self, exchanges: list[Exchange]) -> None:
        """Undo exchanges, and search all pairs that contain these markers again."""
        changed = exchanges[0].markers
        self.points_m = put_back(self.points_m, exchanges)
        for marker in changed:
            self._courses[marker] = self._course(marker)
        for pair in combinations(range(self.points_m.shape[1]), 2):
            if set(pair) & set(changed):
                self._found.pop(pair, None)
                if self._worth(*pair) and pair != changed:
                    self._found[pair] = self._exchanges(*pair)

    def _worth(self, a: int, b: int) -> bool:
        return self._courses[a].jumps and self._courses[b].jumps

    def _course(self, marker: int) -> _Course:
        path = self.points_m[:, marker].copy()
        rows = np.flatnonzero(np.isfinite(path[:, 0]))
        come, go = np.full((2, *path.shape), np.nan)
        times_s, seen = self._times_s[rows], path[rows]
        velocities = np.diff(seen, axis=0) / np.diff(times_s)[:, None]
        come[rows[1:]], go[rows[:-1]] = velocities, velocities
        half_s = 0.5 * np.diff(self._times_s)[:, None]
        misses = np.linalg.norm(before(times_s, seen) - after(times_s, seen), axis=1) if len(rows) > 1 else np.empty(0)
        ratios, jumps = (
            self._scale.ratios(marker, times_s, misses),
            self._scale.torn(marker, times_s, misses, _S.jump_m, _S.jump_sigmas),
        )
        come_m = path[:-1] + half_s * come[:-1]
        misses_m2 = _squares(path[1:] - half_s * go[1:] - come_m)
        return _Course(path, rows, ratios, come, go, come_m, misses_m2, len(jumps) > 0)

    def _exchanges(self, a: int, b: int) -> tuple[float, list[Exchange]]:
        """Return the most likely exchanges of two markers, preceded by the evidence for them, nats."""
        seen = np.isfinite(self._courses[a].path[:, 0] + self._courses[b].path[:, 0])
        rows = np.flatnonzero(seen)
        if len(rows) < 6:
            return 0.0, []
        seams = self._possible_seams(a, b, seen, rows)
        gains = np.full(len(rows) - 1, -np.inf)
        gains[seams] = self._gains(a, b, rows[seams], rows[seams + 1])
        at = _candidates(gains, seams, rows)
        if not len(at):
            return 0.0, []
        hidden = rows[at + 1] - rows[at] >= _S.gap
        paths = [course.path for course in self._courses]
        frames = self._frame_weight * self._distances.cost_of_exchange(paths, a, b)[rows]
        sums = np.concatenate(([0.0], np.cumsum(frames)))
        edges = np.concatenate(([0], at + 1, [len(rows)]))
        body = np.clip(np.diff(sums[edges]), -_S.most_body, _S.most_body)
        gain, states = _most_likely(
            gains[at] - np.where(hidden, _S.change_in_gap, _S.change), body + _S.frame * np.diff(edges)
        )
        stretches = [
            Exchange(int(rows[start]), int(rows[stop - 1]), (a, b))
            for start, stop, state in _merged(edges, states)
            if state
        ]
        return gain, stretches

    def _possible_seams(self, a: int, b: int, seen: Mask, rows: IntArray) -> IntArray:
        """Return the seams, as indices into common frames `rows`, at which an exchange can be more likely than none.

        Between successive frames, one miss must exceed half the distance between the two markers: otherwise each is
        closer to its own continuation.
        """
        own, other = self._courses[a], self._courses[b]
        apart_m2 = _squares(own.come_m - other.come_m)
        beside = np.flatnonzero(4.0 * np.maximum(own.misses_m2, other.misses_m2) > apart_m2)
        return np.union1d((np.cumsum(seen) - 1)[beside], np.flatnonzero(np.diff(rows) > 1))

    def _gains(self, a: int, b: int, start: IntArray, stop: IntArray) -> Array:
        """Return the evidence (K,), nats, that labels change places between frames `start` (K,) and `stop` (K,)."""
        half_s = 0.5 * (self._times_s[stop] - self._times_s[start])[:, None]
        courses = (self._courses[a], self._courses[b])
        come = [course.path[start] + half_s * course.come[start] for course in courses]
        go = [course.path[stop] - half_s * course.go[stop] for course in courses]
        misses = np.array([[np.linalg.norm(c - g, axis=1) for g in go] for c in come])
        sigmas = np.maximum(
            *(
                self._scale.over(marker, 2.0 * half_s[:, 0])
                * sudden(course.ratios, np.searchsorted(course.rows, start))
                for marker, course in zip((a, b), courses, strict=True)
            )
        )
        costs = cost(misses / sigmas)
        return np.nan_to_num(costs[0, 0] + costs[1, 1] - costs[0, 1] - costs[1, 0], nan=-np.inf)


def _squares(apart_m: Array) -> Array:
    return np.asarray(np.einsum("fc,fc->f", apart_m, apart_m))


def _candidates(gains: Array, seams: IntArray, rows: IntArray) -> IntArray:
    """Return the seams at which labels may change places: those with more evidence than seams nearby, or in a gap."""
    hidden = rows[seams + 1] - rows[seams] >= _S.gap
    possible = seams[(gains[seams] > _S.possible) | (hidden & (gains[seams] > _S.possible_in_gap))]
    padded = np.pad(gains, _S.apart, constant_values=-np.inf)
    most = padded[possible[:, None] + np.arange(2 * _S.apart + 1)].max(axis=1, initial=-np.inf)
    hidden = rows[possible + 1] - rows[possible] >= _S.gap
    return np.asarray(possible[hidden | (gains[possible] >= most)])


def _most_likely(gains: Array, exchanged: Array) -> tuple[float, IntArray]:
    """Return the most likely states (K + 1,) between K seams, 1 for exchanged, preceded by the evidence for them.

    Args:
        gains: Evidence (K,) that the state changes, minus the cost of a change.
        exchanged: Cost (K + 1,) of each stretch if its labels are exchanged.
    """
    totals, origins = np.array([0.0, exchanged[0] + _S.at_end]), []
    for gain, cost_here in zip(gains, exchanged[1:], strict=True):
        changed = totals[::-1] - gain
        origins.append(np.where(changed < totals, [1, 0], [0, 1]))
        totals = np.minimum(totals, changed) + np.array([0.0, cost_here])
    totals[1] += _S.at_end
    states = [int(np.argmin(totals))]
    for origin in reversed(origins):
        states.append(int(origin[states[-1]]))
    return -float(totals.min()), np.array(states[::-1])


def _merged(edges: IntArray, states: IntArray) -> list[tuple[int, int, int]]:
    """Return (start, stop, state) of runs of equal states between edges."""
    cuts = np.concatenate(([0], np.flatnonzero(np.diff(states)) + 1, [len(states)]))
    return [(int(edges[i]), int(edges[j]), int(states[i])) for i, j in pairwise(cuts)]


class RigidDistances:
    """Distances, hardly changing in this take, between markers on the same or on neighbouring bones."""

    def __init__(self, points_m: Array, neighbours: Mask) -> None:
        markers = points_m.shape[1]
        self._usual, self._sigmas = np.full((2, markers, markers), np.inf)
        for a, b in zip(*np.nonzero(np.triu(neighbours, 1)), strict=True):
            apart = np.linalg.norm(points_m[:, a] - points_m[:, b], axis=-1)
            apart = apart[np.isfinite(apart)]
            if len(apart) < 10:
                continue
            middle = np.median(apart)
            sigma = 1.48 * np.median(np.abs(apart - middle))
            self._usual[a, b] = self._usual[b, a] = middle
            self._sigmas[a, b] = self._sigmas[b, a] = max(sigma, _S.least_rigid_m) if sigma < _S.rigid_m else np.inf

    def partners(self, marker: int, without: int | None = None) -> IntArray:
        """Return the few markers whose distance from a marker changes least, except the marker `without`."""
        sigmas = self._sigmas[marker].copy()
        if without is not None:
            sigmas[without] = np.inf
        order = np.argsort(sigmas, kind="stable")[: _S.partners]
        return order[np.isfinite(sigmas[order])]

    def cost_of_exchange(self, paths: Sequence[Array], a: int, b: int) -> Array:
        """Return the cost (F,), nats, of exchanging two markers: how much less likely this makes the distances.

        Args:
            paths: Positions (F, 3) of every marker.
        """
        total = np.zeros(len(paths[a]))
        for marker, other in ((a, b), (b, a)):
            for partner in self.partners(marker, other):
                usual, sigma = self._usual[marker, partner], self._sigmas[marker, partner]
                own, theirs = (
                    cost((np.sqrt(_squares(paths[each] - paths[partner])) - usual) / sigma) for each in (marker, other)
                )
                total += np.nan_to_num(theirs - own)
        return total
