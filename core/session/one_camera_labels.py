"""Labels of one camera's blobs: every likely assignment is a hypothesis.

While the best hypothesis leaves blobs unlabelled, others begin from database examples, placed at the body's root and at
the last certain root.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.pose_notes import NoteKind
from ..geometry.arrays import Array, FloatArray, IntArray
from ..geometry.camera import Camera
from ..labelling.single_view_labelling import SingleViewLabeller
from ..labelling.single_view_start import SingleViewStart, label_near, label_single_view
from ..markers.marker_frame import MarkerFrame
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.subject_model import RootPose
from .hypotheses import SETTINGS, Hypothesis, Tracked
from .tracking_quality import assess_fit


@dataclass(frozen=True)
class OneCameraSettings:
    """Settings of `OneCameraLabels`; costs are negative log likelihoods, nats."""

    unlabelled: float = 6.0  # cost of an unlabelled blob
    hopeless: float = 25.0  # cost above which a hypothesis is dropped
    start: float = 15.0  # initial cost of a hypothesis that starts from an example
    suspect: float = 0.6  # agreement below which labels are suspect, as they are with unlabelled blobs
    certain: float = 0.5  # agreement above which the root is certain
    suspect_frames: int = 4  # successive frames with suspect labels after which hypotheses are added
    pause_s: float = 0.2  # between two searches for hypotheses, or for a start pose
    uncertain_s: float = 0.2  # once the last certain root is older, hypotheses are also added at that root
    starts: int = 2  # number of hypotheses added at each root


_S = OneCameraSettings()


@dataclass(eq=False)
class OneCameraHypothesis(Hypothesis):
    """Hypothesis about one camera's blobs."""

    labeller: SingleViewLabeller
    labels: IntArray  # (N,) labels of the last frame's blobs
    markers_m: Array  # (M, 3) markers of the last pose


class OneCameraLabels:
    """Finds the labels of one camera's blobs, see `hypotheses.LabelFinder`.

    Args:
        poses_m: Markers (M, 3) in each pose in which a performer may start, y up, facing +z.
        examples_m: Markers (E, M, 3) in database poses with the root at rest.
    """

    hopeless = _S.hopeless

    def __init__(self, camera: Camera, solver: PoseSolver, poses_m: Sequence[Array], examples_m: FloatArray) -> None:
        self._camera, self._solver, self._torso = camera, solver, solver.subject.torso
        self._poses_m, self._examples_m = poses_m, examples_m.astype(np.float64)
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._certain: tuple[float, RootPose] | None = None
        self._suspect_frames = 0
        self._searched_s = -np.inf

    def begin(self, frame: MarkerFrame, elapsed_s: float) -> OneCameraHypothesis | None:
        """Return a hypothesis for a frame in which a start pose is recognised."""
        if frame.time_s - self._searched_s <= _S.pause_s:
            return None
        self._searched_s = frame.time_s
        start = label_single_view(frame.single_points, self._camera, self._poses_m)
        return None if start is None else self._begun(frame, start, NoteKind.LABELLED)

    def continued(
        self, hypotheses: Sequence[OneCameraHypothesis], frame: MarkerFrame, elapsed_s: float, checks: bool
    ) -> list[OneCameraHypothesis]:
        """Return the best hypotheses among those continued with all likely labels of the next frame."""
        points = frame.single_points
        proposed = [
            (hypothesis.cost + 0.5 * cost, hypothesis, labels)
            for hypothesis in hypotheses
            for cost, labels in hypothesis.labeller.proposals(points, hypothesis.markers_m, elapsed_s)
        ]
        proposed = sorted(proposed, key=lambda row: row[0])[: SETTINGS.most]
        result = []
        for _, last, labels in proposed:
            observation = self._observation(labels, points)
            solution, state = self._solver.step(last.state, observation, frame.time_s)
            labeller = last.labeller.after(points, labels, elapsed_s)
            markers_m = last.markers_m if solution is None else solution.markers_m
            cost = last.cost + _S.unlabelled * float(np.sum(labels < 0))
            cost += min(self._solver.negative_log_likelihood(state), SETTINGS.most_frame)
            tracked = Tracked.of(observation, solution)
            result.append(
                OneCameraHypothesis(state, tracked, last.begun, cost, last.lineage, labeller, labels, markers_m)
            )
        return result

    def others(
        self, hypotheses: Sequence[OneCameraHypothesis], frame: MarkerFrame, elapsed_s: float
    ) -> list[OneCameraHypothesis]:
        """Return hypotheses that begin from examples while the labels of the best one are suspect."""
        best, now_s = hypotheses[0], frame.time_s
        if best.tracked.solution is None:
            return []
        solution = best.tracked.solution
        agreement = assess_fit(best.tracked.observation.back_projected(solution.markers_m), solution).agreement
        if agreement > _S.certain:
            self._certain = (now_s, solution.root)
        suspect = agreement < _S.suspect or np.any(best.labels < 0)
        self._suspect_frames = self._suspect_frames + 1 if suspect else 0
        due = now_s - self._searched_s > _S.pause_s and len(frame.single_points) > 0
        if self._suspect_frames < _S.suspect_frames or not due:
            return []
        self._searched_s = now_s
        roots = [solution.root]
        if self._certain is not None and now_s - self._certain[0] > _S.uncertain_s:
            roots.append(self._certain[1])
        starts: list[SingleViewStart] = []
        for place in roots:
            expected_m = place.to_world(self._examples_m)
            starts += label_near(frame.single_points, self._camera, expected_m, _S.starts)
        if self._certain is None:  # the start itself may have been wrong
            again = label_single_view(frame.single_points, self._camera, self._poses_m)
            starts += [again] if again is not None else []
        known = [hypothesis.labels for hypothesis in hypotheses]
        return [
            self._begun(frame, start, NoteKind.RELABELLED, _S.start)
            for start in starts
            if not any(np.array_equal(start.labels, labels) for labels in known)
        ]

    def confidence(self, hypotheses: Sequence[OneCameraHypothesis], frame: MarkerFrame) -> float:
        """Return 1.0: the rays explain the labels, or they do not (`tracking_quality.assess_fit`)."""
        return 1.0

    def _begun(
        self, frame: MarkerFrame, start: SingleViewStart, note: NoteKind, cost: float = 0.0
    ) -> OneCameraHypothesis:
        """Return a hypothesis that starts from labels found without history."""
        observation = self._observation(start.labels, frame.single_points)
        state = replace(self._solver.initial_state, markers_m=start.markers_m)
        solution, state = self._solver.step(state, observation, frame.time_s)
        labeller = SingleViewLabeller(self._camera, self._torso).after(frame.single_points, start.labels, 0.0)
        markers_m = start.markers_m if solution is None else solution.markers_m
        tracked = Tracked.of(observation, solution)
        return OneCameraHypothesis(state, tracked, note, cost, object(), labeller, start.labels, markers_m)

    def _observation(self, labels: IntArray, points: Array) -> Observation:
        count = len(self._torso)
        named = labels >= 0
        cameras, image_points = np.full(count, -1, dtype=np.int64), np.full((count, 2), np.nan)
        cameras[labels[named]] = 0
        image_points[labels[named]] = points[named]
        return Observation(np.full((count, 3), np.nan), cameras, image_points, (self._camera,))
