"""Alternatives to the labels of a tracked body's points, from searches without history.

The search is repeated: soon while labels are uncertain, rarely otherwise. Labels that it finds are followed as
hypotheses, unless they are hopeless, until the motion shows which are right.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..body.pose_notes import NoteKind
from ..geometry.arrays import Array, IntArray, Mask
from ..labelling.initial_labelling import InitialLabeller, InitialLabels
from ..labelling.label_search import WORK, WORK_UNHURRIED, LabelSearch
from ..labelling.labeller import Labeller
from ..markers.marker_frame import MarkerFrame
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from .body_follower import BodyFollower
from .hypotheses import SETTINGS, Hypothesis, Tracked


@dataclass(frozen=True)
class AlternativeSettings:
    """Settings of `LabelAlternatives`; costs are negative log likelihoods, nats."""

    near_m: float = 0.02  # distance from the closest example below which a nearer one makes no difference
    born: int = 2  # most hypotheses that begin after a search, one a frame, because each is solved
    hopeless: float = 15.0  # cost above which a hypothesis is dropped, or not begun
    start: float = 3.0  # initial cost of labels found by a search
    followed: float = 10.0  # further cost if they relabel markers that were tracked confidently
    sure: float = 2.0  # evidence against all other labels above which the best are certain
    pause_s: float = 0.05  # shortest time between two searches
    rare_s: float = 1.0  # time between searches while labels are certain and fit
    enough: float = 0.6  # share of the markers that must be located for a search


_S = AlternativeSettings()
HOPELESS = _S.hopeless


@dataclass(eq=False)
class PointHypothesis(Hypothesis):
    """Hypothesis about the labels of points."""

    labeller: Labeller
    follower: BodyFollower


@dataclass(frozen=True)
class _Searched:
    """Labels at the time at which a search began."""

    search: LabelSearch
    observed_m: Array  # (M, 3)
    cost: float
    is_confident: Mask  # (M,) markers that had been tracked confidently


class _Alternative(NamedTuple):
    """Labels that a search has found."""

    labels: IntArray  # (N,)
    cost: float  # relative to the current labels
    moved_m: float  # largest distance by which they move a marker
    differs: bool  # they are not the current labels
    contradicts: bool  # they relabel markers that were tracked confidently


class LabelAlternatives:
    """Finds alternatives to the labels of a tracked body, and tells how certain the labels are.

    Args:
        familiar_m: Distance from the closest example above which motion is unfamiliar.
    """

    def __init__(self, solver: PoseSolver, initial: InitialLabeller, familiar_m: float) -> None:
        self._solver, self._initial, self._familiar_m = solver, initial, familiar_m
        self._torso = solver.subject.torso
        self.judge_anew(None)

    def judge_anew(self, lineage: object, start: InitialLabels | None = None, points_m: Array | None = None) -> None:
        """Forget how certain labels are, for those of another hypothesis.

        Args:
            start: Labels of points_m (N, 3) with which the hypothesis begins, and their alternatives.
        """
        self._judged, self._was_confident = lineage, False
        self._misplaced_m = np.inf if start is None else 0.0
        self._waiting: list[_Alternative] = []
        self._followed: list[PointHypothesis] = []
        self._searched: _Searched | None = None
        self._searched_s = -np.inf
        if start is not None and points_m is not None:
            best_m = by_marker(points_m, start.labels, len(self._torso))
            for labels, cost in start.alternatives:
                moved_m = _farthest_m(best_m, by_marker(points_m, labels, len(self._torso)))
                self._misplaced_m = max(self._misplaced_m, _misplaced_m(moved_m, cost - start.cost))

    def misplaced_m(self, hypotheses: Sequence[PointHypothesis]) -> float:
        """Return how far off the best labels are expected to place a marker, as other labels may be the right ones."""
        best_m = hypotheses[0].tracked.observation.points_m
        followed = (
            _misplaced_m(_farthest_m(best_m, each.tracked.observation.points_m), each.cost - _S.start)
            for each in hypotheses[1:]
        )
        waiting = (_misplaced_m(each.moved_m, each.cost) for each in self._waiting if each.differs)
        return max([self._misplaced_m, *waiting, *followed])

    def step(
        self, hypotheses: Sequence[PointHypothesis], frame: MarkerFrame, elapsed_s: float, suspect: bool
    ) -> list[PointHypothesis]:
        """Return new hypotheses, once a search has ended.

        Args:
            hypotheses: Those so far, the best first; it has a solution.
            suspect: There is evidence against the labels of the best.
        """
        best = hypotheses[0]
        if best.lineage is not self._judged:
            misplaced_m = np.inf if best.begun is NoteKind.RELABELLED else self._misplaced_m
            self.judge_anew(best.lineage)
            self._misplaced_m = misplaced_m
        self._confirm_refuted(hypotheses)
        if self._was_confident and not best.labeller.is_confident.any():
            self._misplaced_m = np.inf  # after a cut, or hidden, a body may be another
        calm = (
            not (suspect or self._waiting)
            and self._misplaced_m == 0.0
            and all(each.cost > _S.start + _S.sure for each in hypotheses[1:])
        )
        if calm:
            best.labeller.confirm(best.tracked.observation.located)
        self._was_confident = bool(best.labeller.is_confident.any())
        if self._searched is not None:
            self._searched.search.follow(frame.points_m, elapsed_s)
        elif frame.time_s - self._searched_s >= (_S.rare_s if calm else _S.pause_s):
            self._begin_search(best, frame)
        if self._searched is None or (best.tracked.solution and best.tracked.solution.reinitialised):
            return []
        if not self._waiting:
            if not self._searched.search.advance(WORK_UNHURRIED if calm else WORK):
                return []
            self._waiting = self._alternatives(self._searched)
        born = self._begin_next(self._searched, best, frame)
        if not self._waiting:
            self._searched = None
        self._followed += born
        return born

    def example_cost(self, tracked: Tracked, nearest_m: float | None = None) -> float:
        """Return the negative log likelihood of located markers at this distance from the closest example."""
        located = int(np.count_nonzero(tracked.observation.located))
        if nearest_m is None:
            nearest_m = tracked.solution.nearest_m if tracked.solution else 0.0
        likely_m = min(nearest_m, self._familiar_m) if located else 0.0
        return located * math.log(math.hypot(likely_m, _S.near_m))

    def _closest_cost(self, hypothesis: PointHypothesis) -> float:
        """Return `example_cost` for the closest example to a hypothesis's markers, whatever the motion before."""
        tracked = hypothesis.tracked
        return self.example_cost(tracked, hypothesis.follower.closest_m(tracked.observation))

    def _confirm_refuted(self, hypotheses: Sequence[PointHypothesis]) -> None:
        """Treat the best labels as certain where they differ from labels that the motion has refuted."""
        best = hypotheses[0]
        for other in self._followed:
            if other.cost > _S.hopeless:
                apart_m = best.tracked.observation.points_m - other.tracked.observation.points_m
                best.labeller.confirm(np.linalg.norm(apart_m, axis=1) > SETTINGS.same_m)
        self._followed = [other for other in self._followed if other in hypotheses]

    def _begin_search(self, best: PointHypothesis, frame: MarkerFrame) -> None:
        if len(frame.points_m) < _S.enough * len(self._torso) or best.tracked.solution is None:
            return
        observed_m = best.tracked.observation.points_m
        ghosts = max(len(frame.points_m) - int(np.sum(best.tracked.observation.located)), 0)
        cost = self._initial.cost(observed_m, best.tracked.solution.markers_m, ghosts)
        search = LabelSearch(self._initial, frame.points_m, self._torso)
        self._searched, self._searched_s = _Searched(search, observed_m, cost, best.labeller.is_confident), frame.time_s

    def _alternatives(self, searched: _Searched) -> list[_Alternative]:
        """Return the labels that a search has found and that are to be followed; note how far others move markers."""
        found: list[_Alternative] = []
        self._misplaced_m = 0.0
        for labels, found_cost in searched.search.labellings():
            other_m = by_marker(searched.search.points_m, labels, len(self._torso))
            differs, contradicts = _differences(searched, other_m)
            cost = found_cost - searched.cost + _S.followed * contradicts if differs else 0.0
            other = _Alternative(labels, cost, _farthest_m(searched.observed_m, other_m), differs, contradicts)
            if cost + _S.start <= _S.hopeless and (not differs or sum(each.differs for each in found) < _S.born):
                found.append(other)
            elif cost <= _S.sure:
                self._misplaced_m = max(self._misplaced_m, _misplaced_m(other.moved_m, cost))
        return found

    def _begin_next(self, searched: _Searched, best: PointHypothesis, frame: MarkerFrame) -> list[PointHypothesis]:
        """Begin one of the alternatives that wait; only one a frame, because each is solved.

        Without history, nothing of a frame can be compared but the labels and the examples that are closest to them. If
        an example is much closer than those that the body follows, the body has lost its way with the right labels.
        """
        fresh = self._closest_cost(best)
        renewed = min(fresh - self.example_cost(best.tracked) + _S.start, 0.0)
        while self._waiting:
            other = self._waiting.pop(0)
            begun = self._begun(searched, other, best, frame) if other.differs or renewed else None
            if begun is not None:
                begun.cost = renewed + (other.cost + _S.start if other.differs else 0.0)
                if begun.begun is NoteKind.RELABELLED:  # examples are no evidence against more markers
                    begun.cost += self._closest_cost(begun) - fresh
                return [begun]
        return []

    def _begun(
        self, searched: _Searched, other: _Alternative, best: PointHypothesis, frame: MarkerFrame
    ) -> PointHypothesis | None:
        """Return a hypothesis with other labels, or a new body with the same; None if its labels are no others."""
        labeller, labels = searched.search.carry(other.labels)
        observed_m = best.tracked.observation.points_m
        is_confident = best.labeller.is_confident & (not other.contradicts)
        points, markers = np.nonzero(_is_near(frame.points_m, observed_m))
        labels = labels.copy()
        labels[np.isin(labels, np.flatnonzero(is_confident))] = -1
        # a point that the search left unlabelled keeps its current label, which is newer
        kept = is_confident[markers] | ((labels[points] < 0) & ~np.isin(markers, labels))
        labels[points[kept]] = markers[kept]
        is_same = len(points) > 0 and bool(np.all(labels[points] == markers))
        adds = is_same and int(np.sum(labels >= 0)) > len(points)
        if is_same and not adds and other.differs:
            return None
        labeller.begin(frame.points_m, labels, is_confident)
        other_m = by_marker(frame.points_m, labels, len(self._torso))
        moved = np.linalg.norm(other_m - observed_m, axis=1)[self._torso]
        if adds:
            follower = best.follower.copy()
        elif np.any(moved < SETTINGS.same_m) and not np.any(moved >= SETTINGS.same_m) and best.tracked.solution:
            follower = best.follower.begun_again(self._solver.begin_at_torso(best.tracked.solution))
        else:
            follower = best.follower.begun_again(self._solver.initial_state)
        tracked = follower.begin(Observation.of_points(other_m), frame.time_s)
        if tracked.solution is None:
            return None
        note = NoteKind.RELABELLED
        if is_same:
            note = NoteKind.LABELLED_MORE if adds else NoteKind.NEARER_EXAMPLE
        return PointHypothesis(follower.state, tracked, note, 0.0, object(), labeller, follower)


def by_marker(points_m: Array, labels: IntArray, count: int) -> Array:
    """Return points (N, 3) with labels (N,) in the order of the markers (count, 3), NaN where hidden."""
    result = np.full((count, 3), np.nan)
    result[labels[labels >= 0]] = points_m[labels >= 0]
    return result


def _is_near(points_m: Array, others_m: Array) -> Mask:
    """Return whether points (N, 3) and others (M, 3) are the same, as a mask (N, M)."""
    return np.asarray(np.linalg.norm(points_m[:, None] - others_m[None], axis=-1) < SETTINGS.same_m)


def _farthest_m(points_m: Array, others_m: Array) -> float:
    """Return the largest distance of the markers (M, 3) that both have; infinity for none."""
    apart_m = np.linalg.norm(points_m - others_m, axis=1)
    return float(np.nanmax(apart_m)) if np.isfinite(apart_m).any() else np.inf


def _misplaced_m(moved_m: float, cost: float) -> float:
    """Return the expected distance from the right place if labels with this cost, relative, move a marker so far."""
    return moved_m / (1.0 + math.exp(cost)) if cost <= _S.sure else 0.0


def _differences(searched: _Searched, other_m: Array) -> tuple[bool, bool]:
    """Return whether other labels (M, 3) move or add a marker, and whether they relabel a confidently tracked one."""
    near = _is_near(other_m, searched.observed_m)
    shown, known = np.isfinite(other_m[:, 0]), np.isfinite(searched.observed_m[:, 0])
    differs = bool(np.any(shown & ~near.diagonal()))
    elsewhere = (shown & ~near.diagonal()) | np.any(near & ~np.eye(len(near), dtype=bool), axis=0)
    return differs, bool(np.any(searched.is_confident & known & elsewhere))
