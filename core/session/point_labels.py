"""Labels of points from two or more cameras.

A tracked body's points are labelled by its last pose. Meanwhile the labels are compared with others, found without
history: soon while there is evidence against them, rarely otherwise. Others that are likely are followed as hypotheses
until the motion shows which are right.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.pose_notes import NoteKind
from ..geometry.arrays import Array, IntArray, Mask
from ..geometry.camera import Camera
from ..labelling.initial_labelling import InitialLabeller, InitialLabels
from ..labelling.label_search import WORK, WORK_ALONE, WORK_UNHURRIED, LabelSearch
from ..labelling.labeller import Labeller
from ..markers.marker_frame import MarkerFrame
from ..markers.source_noise import SourceNoise
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.solution import Solution
from .body_examples import BodyExamples
from .body_follower import BodyFollower
from .hypotheses import SETTINGS, Hypothesis, Tracked
from .tracking_quality import assess_fit, tracking_of


@dataclass(frozen=True)
class PointSettings:
    """Settings of `PointLabels`; costs are negative log likelihoods, nats."""

    every: int = 2  # step between the body examples that are used to label points
    nothing: float = 8.0  # cost of each point in a frame without labels
    # RMS distance of the markers from the solved body at which each located marker costs 0.5, and cap on this distance
    fit_m: float = 0.01
    unfit_m: float = 0.03
    near_m: float = 0.02  # distance from the closest example below which a nearer one makes no difference
    most_frame: float = 60.0  # cap on a frame's cost over that of the best hypothesis
    independent_s: float = 0.1  # time in which the costs of frames count as those of one frame
    born: int = 2  # most hypotheses that begin in one frame, because each is solved
    hopeless: float = 15.0  # cost above which a hypothesis is dropped, or not begun
    start: float = 3.0  # initial cost of labels found by a search
    followed: float = 10.0  # further cost if they relabel markers that were tracked confidently
    sure: float = 2.0  # evidence against all other labels above which the best are certain
    pause_s: float = 0.05  # shortest time between two searches
    rare_s: float = 1.0  # time between searches while labels are certain and fit
    enough: float = 0.6  # share of the markers that must be located for a search
    suspect: float = 0.5  # agreement, relative to the share of located markers, below which labels are suspect
    strays: int = 2  # number of unlabelled points, with as many hidden markers, that makes labels suspect
    torso: int = 2  # fewest located torso markers of labels that are not suspect
    uncertain: float = 0.3  # smallest factor by which uncertain labels scale a pose's confidence
    misplaced_m: float = 0.1  # scale on which it falls with the largest distance from a marker with other labels


_S = PointSettings()


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


class PointLabels:
    """Finds the labels of points, see `hypotheses.LabelFinder`.

    Args:
        feet: Mask (M,) of the markers on feet.
        size: Factor of the distances from a single camera at which its source has placed labelled points.
    """

    hopeless = _S.hopeless

    def __init__(
        self,
        solver: PoseSolver,
        cameras: tuple[Camera, ...],
        examples: BodyExamples,
        source: SourceNoise,
        feet: Mask,
        size: float = 1.0,
    ) -> None:
        self._solver, self._cameras, self._size = solver, cameras, size
        self._source, self._feet, self._torso = source, feet, solver.subject.torso
        self._initial = InitialLabeller(examples.markers_m[:: _S.every], examples.ups[:: _S.every], self._torso)
        self._limits = tracking_of(source)
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._start: LabelSearch | None = None
        self._judge_anew(None)

    def _judge_anew(self, lineage: object) -> None:
        """Forget how certain labels are, for those of another hypothesis."""
        self._judged, self._misplaced_m = lineage, np.inf
        self._alternatives: list[PointHypothesis] = []
        self._searched: _Searched | None = None
        self._searched_s = -np.inf

    def begin(self, frame: MarkerFrame, elapsed_s: float) -> PointHypothesis | None:
        """Return a hypothesis with the labels given by the source, or found without history once a search has ended."""
        start = None
        if is_labelled(frame):
            labeller, observation = Labeller(self._torso), self._observe_given_labels(frame)
        else:
            if self._start is None:
                self._start = LabelSearch(self._initial, frame.points_m, self._torso)
            else:
                self._start.follow(frame.points_m, elapsed_s)
            if not self._start.advance(WORK_ALONE):
                return None
            search, self._start = self._start, None
            if search.found is None:
                return None
            labeller, labels = search.carry(search.found.labels)
            observation, start = Observation.of_points(self._by_marker(frame.points_m, labels)), search.found
        follower = BodyFollower(self._solver, self._source, self._feet)
        tracked = follower.step(observation, frame.time_s, elapsed_s, False, start is not None)
        note = None if start is None else NoteKind.LABELLED
        begun = PointHypothesis(follower.state, tracked, note, 0.0, object(), labeller, follower)
        if start is not None:
            if tracked.solution is None:
                return None
            self._judge_anew(begun.lineage)
            likely = [labels for labels, cost in start.alternatives if cost - start.cost <= _S.sure]
            named = [self._by_marker(search.points_m, each) for each in (start.labels, *likely)]
            self._misplaced_m = max((_moved_m(named[0], other_m) for other_m in named[1:]), default=0.0)
        return begun

    def continued(
        self, hypotheses: Sequence[PointHypothesis], frame: MarkerFrame, elapsed_s: float, checks: bool
    ) -> list[PointHypothesis]:
        """Return the hypotheses with the labels of the next frame; if the source labels it, only the best one."""
        given = is_labelled(frame)
        if given or not checks:
            hypotheses = hypotheses[:1]
        followed: list[PointHypothesis] = []
        for each in hypotheses:
            predicted_m = each.state.markers_m
            if given:
                observation = self._observe_given_labels(frame)
            elif predicted_m is not None:
                observation = self.label_tracked(each.labeller, frame, predicted_m, elapsed_s)
            else:
                continue
            each.tracked = each.follower.step(observation, frame.time_s, elapsed_s, checks and given, False)
            each.state = each.follower.state
            followed.append(each)
        if len(followed) > 1:
            costs = np.array([self._cost(frame, each.tracked) for each in followed])
            costs = np.minimum(costs - costs.min(), _S.most_frame) * min(elapsed_s / _S.independent_s, 1.0)
            for each, cost in zip(followed, costs.tolist(), strict=True):
                each.cost += cost
        return followed

    def others(
        self, hypotheses: Sequence[PointHypothesis], frame: MarkerFrame, elapsed_s: float
    ) -> list[PointHypothesis]:
        """Return hypotheses with labels that a search has found and that are not hopeless."""
        best, solution = hypotheses[0], hypotheses[0].tracked.solution
        if solution is None or is_labelled(frame):
            return []
        if best.lineage is not self._judged:
            moved_m = self._misplaced_m
            self._judge_anew(best.lineage)
            if best.begun is not NoteKind.RELABELLED:
                self._misplaced_m = moved_m
        self._confirm_refuted(hypotheses)
        suspect = self._is_suspect(best.tracked, solution, frame)
        others_cost = min((each.cost for each in hypotheses[1:]), default=np.inf)
        calm = self._misplaced_m == 0.0 and not suspect and others_cost > _S.start + _S.sure
        if calm:
            best.labeller.confirm(best.tracked.observation.located)
        if self._searched is not None:
            self._searched.search.follow(frame.points_m, elapsed_s)
        elif frame.time_s - self._searched_s >= (_S.rare_s if calm else _S.pause_s):
            self._begin_search(best, frame)
        if self._searched is None or solution.reinitialised:
            return []
        if not self._searched.search.advance(WORK_UNHURRIED if calm else WORK):
            return []
        searched, self._searched = self._searched, None
        born = self._born(searched, hypotheses, frame)
        self._alternatives += born
        return born

    def confidence(self, hypotheses: Sequence[PointHypothesis], frame: MarkerFrame) -> float:
        """Return the factor by which uncertain labels lower a pose's confidence.

        The farther likely alternatives would move the markers, the lower the factor is: exchanging two adjacent markers
        hardly changes a pose.
        """
        tracked = hypotheses[0].tracked
        if _strays(frame, tracked) >= _S.strays:
            return _S.uncertain
        moved_m = self._misplaced_m
        for each in hypotheses[1:]:
            if each.cost <= _S.start + _S.sure:
                moved_m = max(moved_m, _moved_m(tracked.observation.points_m, each.tracked.observation.points_m))
        return float(_S.uncertain + (1.0 - _S.uncertain) * np.exp(-((moved_m / _S.misplaced_m) ** 2)))

    def label_initially(self, points_m: Array) -> InitialLabels | None:
        """Return labels of points (N, 3) without history, or None if the points do not look like a body."""
        return self._initial.label(points_m)

    def label_cost(self, points: int, observed_m: Array, markers_m: Array, rms_m: float) -> float:
        """Return the negative log likelihood of the labels of a frame.

        Args:
            points: Number of points.
            observed_m: Labelled markers (M, 3), NaN where hidden.
            markers_m: Solved markers (M, 3).
            rms_m: RMS distance between them.
        """
        located = int(np.sum(np.isfinite(observed_m[:, 0])))
        if located == 0:
            return _S.nothing * min(points, len(self._torso))
        cost = self._initial.cost(observed_m, markers_m, max(points - located, 0))
        return cost + 0.5 * located * (float(np.fmin(rms_m, _S.unfit_m)) / _S.fit_m) ** 2

    # ---- searches for other labels

    def _confirm_refuted(self, hypotheses: Sequence[PointHypothesis]) -> None:
        """Treat the best labels as certain where they differ from labels that the motion has refuted."""
        best = hypotheses[0]
        for other in self._alternatives:
            if other.cost > _S.hopeless:
                apart_m = best.tracked.observation.points_m - other.tracked.observation.points_m
                best.labeller.confirm(np.linalg.norm(apart_m, axis=1) > SETTINGS.same_m)
        self._alternatives = [other for other in self._alternatives if other in hypotheses]

    def _begin_search(self, best: PointHypothesis, frame: MarkerFrame) -> None:
        if len(frame.points_m) < _S.enough * len(self._torso) or best.tracked.solution is None:
            return
        observed_m = best.tracked.observation.points_m
        ghosts = max(len(frame.points_m) - int(np.sum(best.tracked.observation.located)), 0)
        cost = self._initial.cost(observed_m, best.tracked.solution.markers_m, ghosts)
        search = LabelSearch(self._initial, frame.points_m, self._torso)
        self._searched, self._searched_s = _Searched(search, observed_m, cost, best.labeller.is_confident), frame.time_s

    def _born(
        self, searched: _Searched, hypotheses: Sequence[PointHypothesis], frame: MarkerFrame
    ) -> list[PointHypothesis]:
        """Return hypotheses with labels that a search has found; note how far other likely ones move the markers."""
        best = hypotheses[0]
        fresh = self._example_cost(best.tracked, best.follower.closest_m(best.tracked.observation))
        # the body may have lost its way with the right labels
        renewed = min(fresh - self._example_cost(best.tracked) + _S.start, 0.0)
        born: list[PointHypothesis] = []
        self._misplaced_m = 0.0
        for labels, found_cost in searched.search.labellings():
            other_m = self._by_marker(searched.search.points_m, labels)
            differs, contradicts = _differences(searched, other_m)
            if not differs and not renewed:
                continue
            cost = found_cost - searched.cost + _S.followed * contradicts if differs else 0.0
            if cost + _S.start <= _S.hopeless and len(born) < _S.born:
                other = self._begun(*searched.search.carry(labels), contradicts, best, frame, not differs)
                if other is None:
                    continue
                if differs:  # without history, nothing else of this frame can be compared
                    cost += self._example_cost(other.tracked) - fresh
                other.cost = renewed + cost + (_S.start if differs else 0.0)
                born.append(other)
            elif cost <= _S.sure:
                self._misplaced_m = max(self._misplaced_m, _moved_m(searched.observed_m, other_m))
        return born

    def _begun(
        self,
        labeller: Labeller,
        labels: IntArray,
        contradicts: bool,
        best: PointHypothesis,
        frame: MarkerFrame,
        renews: bool,
    ) -> PointHypothesis | None:
        """Return a hypothesis with labels (N,) of a frame, or None if they are those of the best hypothesis.

        Args:
            renews: Return a new body with the same labels in place of None.
        """
        observed_m = best.tracked.observation.points_m
        is_confident = best.labeller.is_confident & (not contradicts)
        points, markers = np.nonzero(_is_near(frame.points_m, observed_m))
        labels = labels.copy()
        labels[np.isin(labels, np.flatnonzero(is_confident))] = -1
        # a point that the search left unlabelled keeps its current label, which is newer
        kept = is_confident[markers] | ((labels[points] < 0) & ~np.isin(markers, labels))
        labels[points[kept]] = markers[kept]
        is_same = len(points) > 0 and bool(np.all(labels[points] == markers))
        adds = is_same and int(np.sum(labels >= 0)) > len(points)
        if is_same and not (adds or renews):
            return None
        labeller.begin(frame.points_m, labels, is_confident)
        other_m = self._by_marker(frame.points_m, labels)
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

    def _is_suspect(self, tracked: Tracked, solution: Solution, frame: MarkerFrame) -> bool:
        """Return whether the pose or unlabelled points are evidence against the labels."""
        located = tracked.observation.located
        agreement = assess_fit(tracked.observation, solution, self._limits).agreement
        explained = agreement / max(float(np.mean(located)), 1e-3)
        unseen = np.sum(located & self._torso) < _S.torso
        return bool(explained < _S.suspect or unseen or _strays(frame, tracked) >= _S.strays)

    def _cost(self, frame: MarkerFrame, tracked: Tracked) -> float:
        """Return the negative log likelihood of a hypothesis in a frame.

        To the labels' own it adds that of the markers around the closest example, with the same scale for each marker
        as for all: crossed feet are near to few examples.
        """
        if tracked.solution is None:
            return _S.nothing * min(len(frame.points_m), len(self._torso))
        observed_m, markers_m = tracked.observation.points_m, tracked.solution.markers_m
        cost = self.label_cost(len(frame.points_m), observed_m, markers_m, _rms_m(observed_m, markers_m))
        return cost + self._example_cost(tracked)

    def _example_cost(self, tracked: Tracked, nearest_m: float | None = None) -> float:
        """Return the negative log likelihood of located markers at this distance from the closest example."""
        located = int(np.count_nonzero(tracked.observation.located))
        if nearest_m is None:
            nearest_m = tracked.solution.nearest_m if tracked.solution else 0.0
        likely_m = min(nearest_m, self._limits.familiar_m) if located else 0.0
        return located * math.log(math.hypot(likely_m, _S.near_m))

    # ---- labels of a frame

    def label_tracked(
        self, labeller: Labeller, frame: MarkerFrame, predicted_m: Array, elapsed_s: float
    ) -> Observation:
        """Return the labelled markers of a frame of a tracked body.

        Args:
            labeller: Labeller that has followed the body.
            predicted_m: Markers (M, 3) of the last pose.
            elapsed_s: Time since that pose.
        """
        if not self._cameras or len(frame.blobs) != len(self._cameras):
            labels = labeller.label(frame.points_m, frame.covariances_m2, predicted_m, elapsed_s)
            return Observation.of_points(self._by_marker(frame.points_m, labels))
        found = labeller.label_blobs(frame, self._cameras, predicted_m, elapsed_s)
        single = found.single_cameras
        image_points = found.normalised[np.arange(len(self._torso)), single]
        image_points[single < 0] = np.nan
        return Observation(found.points_m, single, image_points, self._cameras)

    def _observe_given_labels(self, frame: MarkerFrame) -> Observation:
        count = len(self._torso)
        points = self._by_marker(frame.points_m, frame.labels)
        cameras = np.full(count, -1, dtype=np.int64)
        image_points = np.full((count, 2), np.nan)
        usable = (frame.single_labels >= 0) & (len(self._cameras) > 0)
        cameras[frame.single_labels[usable]] = frame.single_cameras[usable]
        image_points[frame.single_labels[usable]] = frame.single_points[usable]
        if len(self._cameras) == 1:
            points = self._cameras[0].centre_m + self._size * (points - self._cameras[0].centre_m)
        else:
            cameras[np.isfinite(points[:, 0])] = -1
        return Observation(points, cameras, image_points, self._cameras)

    def _by_marker(self, points_m: Array, labels: IntArray) -> Array:
        """Return the points (M, 3) in the order of the markers, NaN where hidden."""
        result = np.full((len(self._torso), 3), np.nan)
        result[labels[labels >= 0]] = points_m[labels >= 0]
        return result


def is_labelled(frame: MarkerFrame) -> bool:
    """Return whether the source of a frame labelled its markers."""
    return bool(np.any(frame.labels >= 0) or np.any(frame.single_labels >= 0))


def _strays(frame: MarkerFrame, tracked: Tracked) -> int:
    """Return the number of unlabelled points, at most that of the markers that no camera sees."""
    seen = tracked.observation.seen
    return min(len(frame.points_m), len(seen)) - int(np.count_nonzero(seen))


def _is_near(points_m: Array, others_m: Array) -> Mask:
    """Return whether points (N, 3) and others (M, 3) are the same, as a mask (N, M)."""
    return np.asarray(np.linalg.norm(points_m[:, None] - others_m[None], axis=-1) < SETTINGS.same_m)


def _moved_m(points_m: Array, others_m: Array) -> float:
    """Return the largest distance of the markers (M, 3) that both have; infinity for none."""
    apart_m = np.linalg.norm(points_m - others_m, axis=1)
    return float(np.nanmax(apart_m)) if np.isfinite(apart_m).any() else np.inf


def _rms_m(points_m: Array, others_m: Array) -> float:
    """Return the RMS distance of the markers (M, 3) that both have; infinity for none."""
    squares = np.sum((points_m - others_m) ** 2, axis=1)
    known = squares[np.isfinite(squares)]
    return float(np.sqrt(np.mean(known))) if len(known) else np.inf


def _differences(searched: _Searched, other_m: Array) -> tuple[bool, bool]:
    """Return whether other labels (M, 3) move or add a marker, and whether they relabel a confidently tracked one."""
    near = _is_near(other_m, searched.observed_m)
    shown, known = np.isfinite(other_m[:, 0]), np.isfinite(searched.observed_m[:, 0])
    differs = bool(np.any(shown & ~near.diagonal()))
    elsewhere = (shown & ~near.diagonal()) | np.any(near & ~np.eye(len(near), dtype=bool), axis=0)
    return differs, bool(np.any(searched.is_confident & known & elsewhere))
