"""Labels of points from two or more cameras.

A tracked body's points are labelled by its last pose. Meanwhile the labels are compared with others, found without
history: soon while there is evidence against them, rarely otherwise. Others that are likely are followed as hypotheses
until the motion shows which are right.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.pose_notes import NoteKind
from ..geometry.arrays import Array, Mask
from ..geometry.camera import Camera
from ..labelling.initial_labelling import InitialLabeller, InitialLabels
from ..labelling.label_search import WORK_ALONE, LabelSearch
from ..labelling.labeller import Labeller
from ..markers.marker_frame import MarkerFrame
from ..markers.source_noise import SourceNoise
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.solution import Solution
from .body_examples import BodyExamples
from .body_follower import BodyFollower
from .hypotheses import SETTINGS, Tracked
from .label_alternatives import HOPELESS, LabelAlternatives, PointHypothesis, by_marker
from .tracking_quality import assess_fit, tracking_of


@dataclass(frozen=True)
class PointSettings:
    """Settings of `PointLabels`; costs are negative log likelihoods, nats."""

    every: int = 2  # step between the body examples that are used to label points
    nothing: float = 8.0  # cost of each point in a frame without labels
    # RMS distance of the markers from the solved body at which each located marker costs 0.5, and cap on this distance
    fit_m: float = 0.01
    unfit_m: float = 0.03
    independent_s: float = 0.1  # time in which the costs of frames count as those of one frame
    suspect: float = 0.5  # agreement, relative to the share of located markers, below which labels are suspect
    strays: int = 2  # number of unlabelled points, with as many hidden markers, that makes labels suspect
    uncertain: float = 0.3  # smallest factor by which uncertain labels scale a pose's confidence
    misplaced_m: float = 0.1  # scale on which it falls with the distance by which a marker is expected to be misplaced


_S = PointSettings()


class PointLabels:
    """Finds the labels of points, see `hypotheses.LabelFinder`.

    Args:
        feet: Mask (M,) of the markers on feet.
        size: Factor of the distances from a single camera at which its source has placed labelled points.
    """

    hopeless = HOPELESS

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
        self._alternatives = LabelAlternatives(solver, self._initial, self._limits.familiar_m)
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._start: LabelSearch | None = None
        self._alternatives.judge_anew(None)

    def begin(self, frame: MarkerFrame, elapsed_s: float) -> PointHypothesis | None:
        """Return a hypothesis with the labels given by the source, or found without history once a search has ended."""
        start = None
        if frame.is_labelled:
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
            observation, start = (
                Observation.of_points(by_marker(frame.points_m, labels, len(self._torso))),
                search.found,
            )
        gates_jumps = not (self._cameras and self._source.lasting_m > 0.0)
        follower = BodyFollower(self._solver, self._source, self._feet, gates_jumps)
        tracked = follower.step(observation, frame.time_s, elapsed_s, False, start is not None)
        note = None if start is None else NoteKind.LABELLED
        begun = PointHypothesis(follower.state, tracked, note, 0.0, object(), labeller, follower)
        if start is not None:
            if tracked.solution is None:
                return None
            self._alternatives.judge_anew(begun.lineage, start, search.points_m)
        return begun

    def continued(
        self, hypotheses: Sequence[PointHypothesis], frame: MarkerFrame, elapsed_s: float, checks: bool
    ) -> list[PointHypothesis]:
        """Return the hypotheses with the labels of the next frame; if the source labels it, only the best one."""
        given = frame.is_labelled
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
            costs = np.minimum(costs - costs.min(), SETTINGS.most_frame) * min(elapsed_s / _S.independent_s, 1.0)
            for each, cost in zip(followed, costs.tolist(), strict=True):
                each.cost += cost
        return followed

    def others(
        self, hypotheses: Sequence[PointHypothesis], frame: MarkerFrame, elapsed_s: float
    ) -> list[PointHypothesis]:
        """Return hypotheses with labels that a search has found and that are not hopeless."""
        best, solution = hypotheses[0], hypotheses[0].tracked.solution
        if solution is None or frame.is_labelled:
            return []
        suspect = self._is_suspect(best.tracked, solution, frame)
        return self._alternatives.step(hypotheses, frame, elapsed_s, suspect)

    def confidence(self, hypotheses: Sequence[PointHypothesis], frame: MarkerFrame) -> float:
        """Return the factor by which uncertain labels lower a pose's confidence.

        The farther from its right place a marker is expected to be, the lower the factor is: two adjacent markers that
        may be exchanged hardly change a pose.
        """
        tracked = hypotheses[0].tracked
        if _strays(frame, tracked) >= _S.strays:
            return _S.uncertain
        misplaced_m = self._alternatives.misplaced_m(hypotheses)
        return float(_S.uncertain + (1.0 - _S.uncertain) * np.exp(-((misplaced_m / _S.misplaced_m) ** 2)))

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

    def _is_suspect(self, tracked: Tracked, solution: Solution, frame: MarkerFrame) -> bool:
        """Return whether the pose or unlabelled points are evidence against the labels."""
        located = tracked.observation.located
        agreement = assess_fit(tracked.observation, solution, self._limits).agreement
        explained = agreement / max(np.count_nonzero(located) / len(located), 1e-3)
        unseen = np.count_nonzero(located & self._torso) < self._limits.torso_markers
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
        return cost + self._alternatives.example_cost(tracked)

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
            return Observation.of_points(by_marker(frame.points_m, labels, len(self._torso)))
        found = labeller.label_blobs(frame, self._cameras, predicted_m, elapsed_s)
        single = found.single_cameras
        image_points = found.normalised[np.arange(len(self._torso)), single]
        image_points[single < 0] = np.nan
        return Observation(found.points_m, single, image_points, self._cameras)

    def _observe_given_labels(self, frame: MarkerFrame) -> Observation:
        count = len(self._torso)
        points = by_marker(frame.points_m, frame.labels, len(self._torso))
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


def _strays(frame: MarkerFrame, tracked: Tracked) -> int:
    """Return the number of unlabelled points, at most that of the markers that no camera sees."""
    seen = tracked.observation.seen
    return min(len(frame.points_m), len(seen)) - int(np.count_nonzero(seen))


def _rms_m(points_m: Array, others_m: Array) -> float:
    """Return the RMS distance of the markers (M, 3) that both have; infinity for none."""
    squares = np.sum((points_m - others_m) ** 2, axis=1)
    known = squares[np.isfinite(squares)]
    return float(np.sqrt(np.mean(known))) if len(known) else np.inf
