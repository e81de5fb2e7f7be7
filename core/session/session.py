"""One capture of one subject: marker frames in, pose frames out. Live capture, takes and demo all use it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..body.calibration_poses import standing, t_pose
from ..body.scene_pose import PerformerPose
from ..body.skeleton import marker_positions
from ..database.store import Database
from ..geometry import rotations as rot
from ..geometry.camera import CameraRig
from ..labelling.initial_labelling import InitialLabeller, InitialLabels
from ..labelling.labeller import Labeller
from ..labelling.relabelling import Relabeller
from ..markers.marker_frame import MarkerFrame
from ..markers.subject import Subject
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.settings import SolveSettings
from ..solver.solution import Solution
from ..solver.subject_model import SubjectModel
from .hypothesis_tracking import HypothesisTracker

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_EXPLAINED_M = 0.03  # marker distance at which confidence has fallen to 1/e
_FAMILIAR_M = 0.15  # distance to the closest example at which confidence has fallen to 1/e
_WRONG_M = 0.10  # solved markers further off than this mean that labels or pose are wrong
_WRONG_FOR_S = 0.5  # for so long, and labelling starts afresh
_LOST_FOR_S = 1.0  # without the torso for so long, and labelling starts afresh
_EXAMPLES = 2048  # poses of the database that a body without a past is compared with
_FIRST_CHECK_S = 0.1  # after a start its labels are compared with a new start's; then after twice the time, and so on
_RARE_CHECK_S = 1.0  # from here on only while the markers are badly explained
_DOUBTFUL = 0.5  # confidence
_BETTER = 0.7  # of the labels' distance to the examples: a new start that is closer shows that they are wrong
_SURE_M = 0.04  # labels this near to an example are right: two limbs exchanged across a hand's breadth are further off
_TELLING = 0.75  # share of the markers that must be located: some pose or other is near to fewer
_ELSEWHERE_M = 0.03  # by this much a marker must be another point under a new start's labels
_PROMISING = 0.6  # of the same distance: the closest example alone must be so near for a pose to be solved from it
_NEARER = 0.5  # of the markers' distance to the closest example: a pose without a past that is nearer is the right one


class Session:
    """Labels and solves the frames of one capture in order.

    Args:
        subject: who wears which markers.
        database: motion that the pose is completed from.
        rig: the cameras; needed for markers that one camera sees alone.
        settings: of the solver.
    """

    def __init__(
        self, subject: Subject, database: Database, rig: CameraRig | None = None, settings: SolveSettings | None = None
    ) -> None:
        self.subject = subject
        self.settings = settings or SolveSettings()
        self.rig = rig
        self._cameras = rig.cameras if rig else ()
        self._model = SubjectModel(subject, database.mean_rotations)
        self._solver = PoseSolver(self._model, database, self.settings)
        examples, ups = self._examples(database)
        self._start = InitialLabeller(examples, ups, self._model.torso)
        poses = [self._markers_of(pose(self._model.skeleton)) for pose in (t_pose, standing)]
        one = len(self._cameras) == 1
        self._follower = HypothesisTracker(self._cameras[0], self._model.torso, poses, examples) if one else None
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far; the next frame is labelled afresh."""
        self._last: PerformerPose | None = None
        self._restart()

    def _restart(self) -> None:
        """Let the next frame be labelled and solved as if it were the first."""
        self._solver.reset()
        self._labeller = Labeller(self.subject.marker_set.names, self._model.torso)
        self._second_look = Relabeller(self._start, self._model.torso)
        if self._follower is not None:
            self._follower.reset()
        self._trusted_s: float | None = None
        self._located_s: float | None = None
        self._checked_s: float | None = None
        self._check_after_s = _FIRST_CHECK_S
        self._familiar_s: float | None = None
        self._doubt_after_s = _FIRST_CHECK_S

    def step(self, frame: MarkerFrame) -> PerformerPose:
        """Return the pose of the next marker frame."""
        if self._follower is None or is_labelled(frame):
            observation, solution = self._followed(frame)
        else:
            observation, solution = self._followed_by_one_camera(frame, self._follower)
        result = self._solved(frame, observation, solution) if solution else self._unsolved(frame, observation)
        self._last = result
        if self._lost(result) or self._mislabelled(frame, result):
            self._restart()
        return result

    @property
    def is_waiting(self) -> bool:
        """Whether nothing is known of where the body is."""
        return self._solver.predicted_markers_m() is None

    def expected_markers(self, time_s: float) -> tuple[Array, Array] | None:
        """Return where each marker should be (M, 3) and how far off it may be (M,), metres; None while waiting."""
        predicted = self._solver.predicted_markers_m()
        if predicted is None:
            return None
        return self._labeller.expected(predicted, time_s - self._last.time_s if self._last else 0.0)

    def start(self, points_m: Array) -> InitialLabels | None:
        """Return how points (N, 3) are labelled when nothing is known of the body; None when they are not like it."""
        return self._start.label(points_m)

    def _followed(self, frame: MarkerFrame) -> tuple[Observation, Solution | None]:
        observation = self._label(frame)
        if self._second_look.changed:
            self._solver.reset()
        return observation, self._undeceived(frame, observation, self._solver.step(observation, frame.time_s))

    def _undeceived(self, frame: MarkerFrame, observation: Observation, solution: Solution | None) -> Solution | None:
        """Return the pose of a solver without a past in place of one that the database is far from, if it is near.

        A pose that has gone wrong keeps itself: examples are looked for near where the motion seems to go. All
        markers may then be where they should be, on a body that is wrung. This is looked at when it has lasted for a
        moment and most markers are located, then ever more rarely.
        """
        now = frame.time_s
        if solution is None or not solution.nearest_m > _FAMILIAR_M:
            self._familiar_s, self._doubt_after_s = now, _FIRST_CHECK_S
            return solution
        if self._familiar_s is None:
            self._familiar_s = now
        if now - self._familiar_s < self._doubt_after_s or np.mean(observation.located) < _TELLING:
            return solution
        self._familiar_s, self._doubt_after_s = now, min(2.0 * self._doubt_after_s, _RARE_CHECK_S)
        anew = self._solver.without_past()
        if not anew.closest_m(observation) < _PROMISING * solution.nearest_m:
            return solution
        found = anew.step(observation, now)
        if found is None or not found.nearest_m < _NEARER * solution.nearest_m:
            return solution
        self._solver = anew
        return found

    def _followed_by_one_camera(
        self, frame: MarkerFrame, follower: HypothesisTracker
    ) -> tuple[Observation, Solution | None]:
        way = follower.step(frame, self._solver, self._last.confidence if self._last else 0.0)
        if way is None:
            return Observation.of_points(np.full((len(self.subject.marker_set), 3), np.nan)), None
        self._solver = way.solver
        return way.observation, way.solution

    def _examples(self, database: Database) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return markers (E, M, 3) with the root at rest, and the root's way up (E, 3), of poses of all kinds."""
        model = self._model
        frames = np.unique(np.linspace(0, database.frames - 1, _EXAMPLES).astype(np.int64))
        posed = [self._markers_of(pose(model.skeleton)) for pose in (t_pose, standing)]
        upright = np.array([0.0, 1.0, 0.0])
        ups = rot.rotate(rot.conjugate(database.root_rotations[frames]), upright)
        examples = np.concatenate((model.database_markers(database, frames), posed)).astype(np.float32)
        return examples, np.concatenate((ups, [upright, upright])).astype(np.float32)

    def _markers_of(self, rotations: Array) -> Array:
        model = self._model
        return marker_positions(model.skeleton, model.joints, model.offsets_m, rotations, np.zeros(3))

    def _label(self, frame: MarkerFrame) -> Observation:
        """Return what was seen of each marker."""
        predicted = self._solver.predicted_markers_m()
        count = len(self.subject.marker_set)
        if is_labelled(frame):
            return self._known(frame)
        if predicted is None:
            start = self.start(frame.points_m)
            labels = start.labels if start else np.full(len(frame.points_m), -1)
            self._labeller.begin(frame.points_m, labels)
            return Observation.of_points(_by_marker(frame.points_m, labels, count))
        return self.label_followed(frame, predicted, frame.time_s - self._last.time_s if self._last else 0.0)

    def label_followed(self, frame: MarkerFrame, predicted: Array, elapsed: float) -> Observation:
        """Return what was seen of each marker of a body that is followed.

        Args:
            frame: without labels.
            predicted: (M, 3) markers of the last synthesized pose, metres.
            elapsed: time since that pose, seconds.
        """
        count = len(self.subject.marker_set)
        if not self._cameras or len(frame.blobs) != len(self._cameras):
            labels = self._labeller.label(frame.points_m, frame.covariances_m2, predicted, elapsed)
            return self._reconsidered(
                frame, Observation.of_points(_by_marker(frame.points_m, labels, count)), frame.points_m[labels < 0]
            )
        found = self._labeller.label_blobs(frame, self._cameras, predicted, elapsed)
        single = found.single_cameras
        image_points = found.normalised[np.arange(count), single]
        image_points[single < 0] = np.nan
        observation = Observation(found.points_m, single, image_points, self._cameras)
        return self._reconsidered(frame, observation, found.unlabelled_points(frame))

    def _reconsidered(self, frame: MarkerFrame, observation: Observation, unnamed_m: Array) -> Observation:
        """Return what was seen under better labels, where a second look finds them."""
        better = self._second_look.relabel(frame.time_s, observation.points_m, unnamed_m)
        if better is None:
            return observation
        self._labeller.correct(better)
        return Observation.of_points(better)

    def _known(self, frame: MarkerFrame) -> Observation:
        """Return what was seen where the source knows the labels."""
        count = len(self.subject.marker_set)
        points = _by_marker(frame.points_m, frame.labels, count)
        cameras = np.full(count, -1, dtype=np.int64)
        image_points = np.full((count, 2), np.nan)
        usable = (frame.single_labels >= 0) & (len(self._cameras) > 0)
        cameras[frame.single_labels[usable]] = frame.single_cameras[usable]
        image_points[frame.single_labels[usable]] = frame.single_points[usable]
        cameras[np.isfinite(points[:, 0])] = -1
        return Observation(points, cameras, image_points, self._cameras)

    def _solved(self, frame: MarkerFrame, observation: Observation, solution: Solution) -> PerformerPose:
        # with one camera what counts is how far the markers are from their rays
        shown = observation.back_projected(solution.markers_m) if len(self._cameras) == 1 else observation
        located = shown.located
        distances = np.linalg.norm(solution.markers_m[located] - shown.points_m[located], axis=1)
        rms = float(np.sqrt(np.mean(distances**2))) if np.any(located) else float("nan")
        seen = np.sum(located) + 0.5 * np.sum(shown.single)
        nearest = solution.nearest_m
        confidence = seen / len(located)
        if np.any(located):
            confidence *= np.exp(-((rms / _EXPLAINED_M) ** 2)) * np.exp(-((nearest / _FAMILIAR_M) ** 2))
        hidden = [text for text, there in zip(self.subject.marker_set.texts, located, strict=True) if not there]
        notes = list(frame.notes)
        notes += [", ".join(hidden) + " hidden"] if hidden else []
        notes += ["this motion is unlike the database"] if nearest > _FAMILIAR_M else []
        return PerformerPose(
            number=frame.number,
            time_s=frame.time_s,
            rotations=self._model.rotations(solution.pose, solution.root),
            root_position_m=solution.root.position_m,
            confidence=float(confidence),
            markers_m=solution.markers_m,
            observed_m=observation.points_m,
            single_cameras=observation.cameras,
            marker_rms_m=rms,
            neighbours=solution.neighbours,
            dimensions=solution.dimensions,
            notes=tuple(notes),
        )

    def _unsolved(self, frame: MarkerFrame, observation: Observation) -> PerformerPose:
        """Return the last pose, or the T pose at the origin, for a frame that does not show where the body is."""
        notes = (*frame.notes, "waiting for the markers of the torso")
        if self._last is not None:
            return replace(
                self._last,
                number=frame.number,
                time_s=frame.time_s,
                confidence=0.0,
                observed_m=observation.points_m,
                single_cameras=observation.cameras,
                marker_rms_m=float("nan"),
                notes=notes,
            )
        rotations = t_pose(self.subject.skeleton)
        height = -float(self._markers_of(rotations)[:, 1].min())
        position = np.array([0.0, height, 0.0])
        markers = self._markers_of(rotations) + position
        return PerformerPose(
            frame.number,
            frame.time_s,
            rotations,
            position,
            0.0,
            markers,
            observation.points_m,
            observation.cameras,
            float("nan"),
            notes=notes,
        )

    def _lost(self, result: PerformerPose) -> bool:
        """Whether the torso has been lost, or the solved markers have been wrong, for a while."""
        now = result.time_s
        shown = np.isfinite(result.observed_m[:, 0]) | ((result.single_cameras >= 0) & (len(self._cameras) == 1))
        if np.sum(shown & self._model.torso) >= 2 or self._located_s is None:
            self._located_s = now
        if not result.marker_rms_m > _WRONG_M or self._trusted_s is None:
            self._trusted_s = now
        return now - self._located_s > _LOST_FOR_S or now - self._trusted_s > _WRONG_FOR_S

    def _mislabelled(self, frame: MarkerFrame, result: PerformerPose) -> bool:
        """Whether the points, labelled as if nothing were known, are clearly more like a body than as they are.

        A wrong start can go on for long: what it makes of the markers is explained, if badly. So it is looked at
        again soon after, then ever more rarely.
        """
        now = result.time_s
        if is_labelled(frame) or self.is_waiting:
            return False
        if self._checked_s is None:
            self._checked_s = now
        if now - self._checked_s < self._check_after_s:
            return False
        if self._check_after_s >= _RARE_CHECK_S and result.confidence > _DOUBTFUL:
            return False
        self._checked_s, self._check_after_s = now, min(2.0 * self._check_after_s, _RARE_CHECK_S)
        as_they_are_m = self._start.distance_m(result.observed_m, result.markers_m)
        if as_they_are_m < _SURE_M:
            return False
        start = self.start(frame.points_m)
        if start is None or not start.distance_m < _BETTER * as_they_are_m:
            return False
        named_m = _by_marker(frame.points_m, start.labels, len(self.subject.marker_set))
        return bool(np.any(np.linalg.norm(named_m - result.observed_m, axis=1) > _ELSEWHERE_M))


def is_labelled(frame: MarkerFrame) -> bool:
    """Whether the source knows which marker is which."""
    return bool(np.any(frame.labels >= 0) or np.any(frame.single_labels >= 0))


def _by_marker(points_m: Array, labels: IntArray, count: int) -> Array:
    """Return the points (M, 3) by marker, NaN where none was labelled as it."""
    result = np.full((count, 3), np.nan)
    result[labels[labels >= 0]] = points_m[labels >= 0]
    return result
