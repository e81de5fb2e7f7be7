"""Labelling one camera's blobs with several hypotheses in parallel.

Blobs of markers that reappear or cross in the image have several possible labels, and only the motion that follows
shows which are right (multiple hypothesis tracking, Reid 1979). Each hypothesis has its own solver state and
likelihood. While the best one leaves blobs unlabelled, hypotheses are added from database examples, placed at the
body's root and at the last certain root.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray
from ..geometry.camera import Camera
from ..labelling.single_view_labelling import SingleViewLabeller
from ..labelling.single_view_start import SingleViewStart, label_near, label_single_view
from ..markers.marker_frame import MarkerFrame
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.solution import Solution, SolverState
from ..solver.subject_model import RootPose

_MOST_HYPOTHESES = 5
# costs are negative log likelihoods
_UNLABELLED_COST = 6.0  # cost of an unlabelled blob
_MOST_FRAME_COST = 60.0  # cap on the cost of one frame, so that no outlier is decisive
_HOPELESS = 25.0  # cost relative to the best hypothesis above which one is dropped
_START_COST = 15.0  # initial cost of a hypothesis that starts from an example
_SAME_M = 0.02  # distance of every marker below which two hypotheses are the same
_SUSPECT = 0.6  # agreement below which labels are suspect, as they are with unlabelled blobs
_CERTAIN = 0.5  # agreement above which the root is certain
_SUSPECT_FRAMES = 4  # successive frames with suspect labels after which hypotheses are added
_SEARCH_S = 0.2  # pause between two searches for hypotheses, or for a start pose
_UNCERTAIN_S = 0.2  # once the last certain root is older than this, hypotheses are also added at that root
_STARTS = 2  # number of hypotheses added at each root


@dataclass
class Hypothesis:
    """Labels of the blobs so far, with the last frame's solution."""

    state: SolverState
    labeller: SingleViewLabeller
    labels: IntArray  # (N,) labels of the last frame's blobs
    markers_m: Array  # (M, 3) markers of the last pose
    observation: Observation
    solution: Solution | None
    cost: float = 0.0  # relative to the best hypothesis
    start_s: float = 0.0  # time of the frame that was labelled without history


class HypothesisTracker:
    """Labels and solves successive frames of one camera.

    Args:
        poses_m: Markers (M, 3) in each pose in which a performer may start, y up, facing +z.
        examples_m: Markers (E, M, 3) in database poses with the root at rest.
    """

    def __init__(self, camera: Camera, solver: PoseSolver, poses_m: Sequence[Array], examples_m: FloatArray) -> None:
        self._camera, self._solver, self._torso = camera, solver, solver.subject.torso
        self._poses_m, self._examples_m = poses_m, examples_m.astype(np.float64)
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._hypotheses: list[Hypothesis] = []
        self._time_s = 0.0
        self._certain: tuple[float, RootPose] | None = None
        self._suspect_frames = 0
        self._searched_s = -np.inf

    def step(self, frame: MarkerFrame, agreement: float) -> Hypothesis | None:
        """Return the best hypothesis after the next frame; None until a start pose has been recognised.

        Args:
            agreement: Agreement of the last pose, see `tracking_quality.Fit`.
        """
        if self._hypotheses:
            self._continue(frame, frame.time_s - self._time_s)
            self._spawn_hypotheses(frame, agreement)
        elif frame.time_s - self._searched_s > _SEARCH_S:
            self._searched_s = frame.time_s
            start = label_single_view(frame.single_points, self._camera, self._poses_m)
            if start is not None:
                self._hypotheses = [self._begin(frame, start)]
        self._time_s = frame.time_s
        return self._hypotheses[0] if self._hypotheses else None

    def _begin(self, frame: MarkerFrame, start: SingleViewStart, cost: float = 0.0) -> Hypothesis:
        """Return a hypothesis that starts from labels found without history."""
        observation = self._observation(start.labels, frame.single_points)
        state = replace(self._solver.initial_state, markers_m=start.markers_m)
        solution, state = self._solver.step(state, observation, frame.time_s)
        labeller = SingleViewLabeller(self._camera, self._torso).after(frame.single_points, start.labels, 0.0)
        markers_m = start.markers_m if solution is None else solution.markers_m
        return Hypothesis(state, labeller, start.labels, markers_m, observation, solution, cost, frame.time_s)

    def _continue(self, frame: MarkerFrame, elapsed_s: float) -> None:
        """Continue every hypothesis with all likely labels of the frame, and keep the best hypotheses."""
        points = frame.single_points
        proposed = [
            (hypothesis.cost + 0.5 * cost, hypothesis, labels)
            for hypothesis in self._hypotheses
            for cost, labels in hypothesis.labeller.proposals(points, hypothesis.markers_m, elapsed_s)
        ]
        proposed = sorted(proposed, key=lambda row: row[0])[:_MOST_HYPOTHESES]
        hypotheses = []
        for _, last, labels in proposed:
            observation = self._observation(labels, points)
            solution, state = self._solver.step(last.state, observation, frame.time_s)
            cost = last.cost
            if len(proposed) > 1:
                cost += min(self._solver.negative_log_likelihood(state), _MOST_FRAME_COST)
                cost += _UNLABELLED_COST * float(np.sum(labels < 0))
            labeller = last.labeller.after(points, labels, elapsed_s)
            markers_m = last.markers_m if solution is None else solution.markers_m
            hypotheses.append(Hypothesis(state, labeller, labels, markers_m, observation, solution, cost, last.start_s))
        self._hypotheses = _prune(hypotheses)

    def _spawn_hypotheses(self, frame: MarkerFrame, agreement: float) -> None:
        """Add hypotheses from examples while the labels of the best one are suspect."""
        best, now_s = self._hypotheses[0], frame.time_s
        if best.solution is None:
            return
        root = best.solution.root
        if agreement > _CERTAIN:
            self._certain = (now_s, root)
        suspect = agreement < _SUSPECT or np.any(best.labels < 0)
        self._suspect_frames = self._suspect_frames + 1 if suspect else 0
        due = now_s - self._searched_s > _SEARCH_S and len(frame.single_points) > 0
        if self._suspect_frames < _SUSPECT_FRAMES or not due:
            return
        self._searched_s = now_s
        roots = [root]
        if self._certain is not None and now_s - self._certain[0] > _UNCERTAIN_S:
            roots.append(self._certain[1])
        starts: list[SingleViewStart] = []
        for place in roots:
            expected_m = place.to_world(self._examples_m)
            starts += label_near(frame.single_points, self._camera, expected_m, _STARTS)
        if self._certain is None:  # the start itself may have been wrong
            again = label_single_view(frame.single_points, self._camera, self._poses_m)
            starts += [again] if again is not None else []
        for start in starts:
            if not any(np.array_equal(start.labels, hypothesis.labels) for hypothesis in self._hypotheses):
                self._hypotheses.append(self._begin(frame, start, _START_COST))

    def _observation(self, labels: IntArray, points: Array) -> Observation:
        count = len(self._torso)
        named = labels >= 0
        cameras, image_points = np.full(count, -1, dtype=np.int64), np.full((count, 2), np.nan)
        cameras[labels[named]] = 0
        image_points[labels[named]] = points[named]
        return Observation(np.full((count, 3), np.nan), cameras, image_points, (self._camera,))


def _prune(hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Return the likely hypotheses, best first, with costs relative to the best."""
    hypotheses = sorted(hypotheses, key=lambda hypothesis: hypothesis.cost)
    least = hypotheses[0].cost
    result: list[Hypothesis] = []
    for hypothesis in hypotheses:
        hypothesis.cost -= least
        if hypothesis.cost <= _HOPELESS and not any(_is_same(hypothesis, other) for other in result):
            result.append(hypothesis)
    return result


def _is_same(one: Hypothesis, other: Hypothesis) -> bool:
    return np.array_equal(one.labels, other.labels) and bool(np.abs(one.markers_m - other.markers_m).max() < _SAME_M)
