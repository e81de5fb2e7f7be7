"""A body followed by one camera alone: several ways of naming its blobs side by side, until one proves right.

A marker that comes back from behind the body, and two that pass each other in the image, may be named in more than one
way, and only the motion that follows tells which is right (multiple hypothesis tracking, Reid 1979). Each way has a
solver of its own; what it expected of the frames it has seen tells how likely it is. Where no way explains all blobs,
poses of the database are laid where the body is, or last was for certain, and their labels tried as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.camera import Camera
from ..labelling.single_view_labelling import SingleViewLabeller
from ..labelling.single_view_start import SingleViewStart, label_near, label_single_view
from ..markers.marker_frame import MarkerFrame
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.solution import Solution
from ..solver.subject_model import RootPose

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int64]

_MOST_WAYS = 5
# costs are minus logarithms of likelihoods
_UNNAMED_COST = 6.0  # of a blob that is no marker's
_MOST_SURPRISE = 60.0  # that one frame counts: a single odd one must not decide
_HOPELESS = 25.0  # costlier than the best by so much, a way is given up
_NEW_COST = 15.0  # of a way that starts afresh
_SAME_M = 0.02  # ways whose markers are so close are one
_DOUBTFUL = 0.6  # confidence below which labels may be wrong, as when a blob has no name
_CERTAIN = 0.5  # confidence at which the body is where it is thought to be
_DOUBTFUL_FRAMES = 4  # in a row, until labels are looked for afresh
_LOOK_S = 0.2  # between two such looks, and two for a performer who has not started
_UNCERTAIN_S = 0.2  # after which the body is also looked for where it last was for certain
_NEW_WAYS = 2  # of each place


@dataclass
class Way:
    """One way of naming the blobs so far.

    Args:
        solver: with the poses that follow from it.
        labeller: with the markers' movements in the image.
        labels: (N,) of the last frame's blobs.
        markers_m: (M, 3) of the last synthesized pose.
        observation, solution: of the last frame.
        cost: above that of the best way.
    """

    solver: PoseSolver
    labeller: SingleViewLabeller
    labels: IntArray
    markers_m: Array
    observation: Observation
    solution: Solution | None
    cost: float = 0.0


class SingleViewFollower:
    """Names and solves the frames of one camera in order.

    Args:
        camera: that sees them.
        torso: (M,) which markers lie on the torso.
        poses_m: markers (M, 3) of the poses in which a performer may start, y up, facing +z.
        examples_m: (E, M, 3) markers of poses of the database with the root at rest.
    """

    def __init__(
        self, camera: Camera, torso: NDArray[np.bool_], poses_m: Sequence[Array], examples_m: FloatArray
    ) -> None:
        self._camera, self._torso = camera, torso
        self._poses_m, self._examples_m = poses_m, examples_m.astype(np.float64)
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._ways: list[Way] = []
        self._time_s = 0.0
        self._certain: tuple[float, RootPose] | None = None
        self._doubts = 0
        self._looked_s = -np.inf

    def step(self, frame: MarkerFrame, solver: PoseSolver, confidence: float) -> Way | None:
        """Return the best way after the next frame; None until the performer stands in one of the poses.

        Args:
            frame: with what the camera shows.
            solver: for the first frame, without a past.
            confidence: in the pose of the frame before.
        """
        if not self._ways and frame.time_s - self._looked_s > _LOOK_S:
            self._looked_s = frame.time_s
            start = label_single_view(frame.single_points, self._camera, self._poses_m)
            if start is not None:
                self._ways = [self._started(frame, start, solver)]
        elif self._ways:
            self._follow(frame, frame.time_s - self._time_s)
            self._doubt(frame, confidence)
        self._time_s = frame.time_s
        return self._ways[0] if self._ways else None

    def _started(self, frame: MarkerFrame, start: SingleViewStart, solver: PoseSolver, cost: float = 0.0) -> Way:
        """Return the way that begins with labels found without a past."""
        observation = self._observed(start.labels, frame.single_points)
        solution = solver.step(observation, frame.time_s, start.markers_m)
        labeller = SingleViewLabeller(self._camera, self._torso).after(frame.single_points, start.labels, 0.0)
        markers_m = start.markers_m if solution is None else solution.markers_m
        return Way(solver, labeller, start.labels, markers_m, observation, solution, cost)

    def _follow(self, frame: MarkerFrame, elapsed_s: float) -> None:
        """Let every way go on, in all likely ones, and keep those that are not hopeless."""
        points = frame.single_points
        proposed = [
            (way.cost + 0.5 * cost, way, labels)
            for way in self._ways
            for cost, labels in way.labeller.proposals(points, way.markers_m, elapsed_s)
        ]
        proposed = sorted(proposed, key=lambda row: row[0])[:_MOST_WAYS]
        # each goes on with a solver of its own; the last of a way's may have the way's own
        solvers = [way.solver.branch() for _, way, _ in proposed[1:]]
        ways = []
        for solver, (_, way, labels) in zip([proposed[0][1].solver, *solvers], proposed, strict=True):
            observation = self._observed(labels, points)
            solution = solver.step(observation, frame.time_s)
            cost = way.cost
            if len(proposed) > 1:
                cost += min(solver.surprise(), _MOST_SURPRISE) + _UNNAMED_COST * float(np.sum(labels < 0))
            labeller = way.labeller.after(points, labels, elapsed_s)
            markers_m = way.markers_m if solution is None else solution.markers_m
            ways.append(Way(solver, labeller, labels, markers_m, observation, solution, cost))
        self._ways = _kept(ways)

    def _doubt(self, frame: MarkerFrame, confidence: float) -> None:
        """Look for other labels while the best way's are doubtful."""
        best, now_s = self._ways[0], frame.time_s
        if best.solution is None:
            return
        root = best.solution.root
        if confidence > _CERTAIN:
            self._certain = (now_s, root)
        self._doubts = self._doubts + 1 if confidence < _DOUBTFUL or np.any(best.labels < 0) else 0
        if self._doubts < _DOUBTFUL_FRAMES or now_s - self._looked_s <= _LOOK_S or len(frame.single_points) == 0:
            return
        self._looked_s = now_s
        roots = [root]
        if self._certain is not None and now_s - self._certain[0] > _UNCERTAIN_S:
            roots.append(self._certain[1])
        starts: list[SingleViewStart] = []
        for place in roots:
            expected_m = place.to_world(self._examples_m)
            starts += label_near(frame.single_points, self._camera, expected_m, _NEW_WAYS)
        if self._certain is None:  # the start itself may have been wrong
            again = label_single_view(frame.single_points, self._camera, self._poses_m)
            starts += [again] if again is not None else []
        for start in starts:
            if not any(np.array_equal(start.labels, way.labels) for way in self._ways):
                solver = best.solver.branch()
                solver.reset()
                self._ways.append(self._started(frame, start, solver, _NEW_COST))

    def _observed(self, labels: IntArray, points: Array) -> Observation:
        count = len(self._torso)
        named = labels >= 0
        cameras, image_points = np.full(count, -1, dtype=np.int64), np.full((count, 2), np.nan)
        cameras[labels[named]] = 0
        image_points[labels[named]] = points[named]
        return Observation(np.full((count, 3), np.nan), cameras, image_points, (self._camera,))


def _kept(ways: list[Way]) -> list[Way]:
    """Return the ways worth keeping, best first, each once, with costs above the best's."""
    ways = sorted(ways, key=lambda way: way.cost)
    least = ways[0].cost
    result: list[Way] = []
    for way in ways:
        way.cost -= least
        if way.cost <= _HOPELESS and not any(_is_same(way, other) for other in result):
            result.append(way)
    return result


def _is_same(way: Way, other: Way) -> bool:
    return np.array_equal(way.labels, other.labels) and bool(np.abs(way.markers_m - other.markers_m).max() < _SAME_M)
