"""Labelling the marker frames of one capture."""

from typing import NamedTuple

import numpy as np

from ..body.calibration_poses import standing, t_pose
from ..body.scene_pose import PerformerPose
from ..body.skeleton import marker_positions
from ..database.store import Database
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from ..geometry.camera import Camera
from ..labelling.initial_labelling import InitialLabeller, InitialLabels
from ..labelling.label_search import WORK_ALONE, LabelSearch
from ..labelling.labeller import Labeller
from ..markers.marker_frame import MarkerFrame
from ..solver.observation import Observation
from ..solver.subject_model import SubjectModel
from .label_check import Alternative, LabelCheck

_EXAMPLES = 2048  # number of database poses for labelling without history
_EVERY = 2  # step between those of these poses that are used to label points
_SAME_M = 0.02  # distance up to which two points are the same
_NOTHING_COST = 8.0  # cost of each point in a frame without labels
# RMS distance of the markers from the solved body at which each located marker costs 0.5; cap on this distance
_FIT_M, _UNFIT_M = 0.01, 0.03


class AlternativeLabels(NamedTuple):
    """Alternative labels of a solved frame."""

    observation: Observation
    nearer: float  # accepted if the distance to the closest example falls below this share of the current one
    adds: bool  # they only label points that have no label now
    keeps_torso: bool  # the torso markers keep their points, so that the pose shows where the torso is
    labeller: Labeller  # follows these labels
    time_s: float
    alternative: Alternative


class BodyExamples:
    """Markers in many poses, for labelling without history.

    Attributes:
        start_poses_m: Markers (M, 3) in the T pose and in a standing pose.
        markers_m: Markers (E, M, 3) in many poses with the root at rest.
        ups: Up direction (E, 3) of these poses in the root's frame.
    """

    def __init__(self, model: SubjectModel, database: Database) -> None:
        self.start_poses_m = [rest_markers(model, pose(model.skeleton)) for pose in (t_pose, standing)]
        frames = np.unique(np.linspace(0, database.frames - 1, _EXAMPLES).astype(np.int64))
        upright = np.array([0.0, 1.0, 0.0])
        ups = rot.vertical_in(database.root_rotations[frames])
        markers = np.concatenate((model.database_markers(database, frames), self.start_poses_m))
        self.markers_m: FloatArray = markers.astype(np.float32)
        self.ups: FloatArray = np.concatenate((ups, [upright, upright])).astype(np.float32)


def rest_markers(model: SubjectModel, rotations: Array) -> Array:
    """Return the markers (M, 3) for joint rotations (J, 4) with the root at the origin."""
    return marker_positions(model.skeleton, model.joints, model.offsets_m, rotations, np.zeros(3))


class FrameLabeller:
    """Labels successive marker frames of one body.

    Args:
        size: Factor of the distances from a single camera at which its source has placed labelled points.

    Attributes:
        searched: The last frame needed a full label search.
    """

    def __init__(
        self, model: SubjectModel, cameras: tuple[Camera, ...], examples: BodyExamples, size: float = 1.0
    ) -> None:
        self._torso, self._cameras, self._size = model.torso, cameras, size
        self._initial = InitialLabeller(examples.markers_m[::_EVERY], examples.ups[::_EVERY], model.torso)
        self.labellings = 0
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._labeller = Labeller(self._torso)
        self._search: LabelSearch | None = None
        self.searched = False
        self._check = LabelCheck(self._initial, self._torso)

    def confidence(self, frame: MarkerFrame, seen: Mask) -> float:
        """Return the factor by which uncertain labels lower a pose's confidence, see `LabelCheck.confidence`."""
        return self._check.confidence(frame, seen)

    def find_alternative(
        self, frame: MarkerFrame, elapsed_s: float, pose: PerformerPose, agreement: float, busy: bool = False
    ) -> AlternativeLabels | None:
        """Return alternative labels for a solved frame if the frame makes any likely.

        Args:
            agreement: Agreement of its pose, see `tracking_quality.Fit`.
            busy: The frame was already expensive, so the search pauses.
        """
        alternative = self._check.step(frame, elapsed_s, pose, agreement, self._labeller.is_confident, busy)
        if alternative is None:  # a pose that has just become suspect does not confirm labels
            if self._check.is_certain(frame, pose.seen):
                self._labeller.confirm(self._check.confirmed_markers)
            return None
        labeller, labels = alternative.search.carry(alternative.labels)
        is_confident = self._labeller.is_confident & (not alternative.contradicts)
        away = np.linalg.norm(frame.points_m[:, None] - pose.observed_m[None], axis=-1)
        points, markers = np.nonzero(away < _SAME_M)
        labels[np.isin(labels, np.flatnonzero(is_confident))] = -1
        # a point that the search left unlabelled keeps its current label, which is newer
        kept = is_confident[markers] | ((labels[points] < 0) & ~np.isin(markers, labels))
        labels[points[kept]] = markers[kept]
        is_same = labels[points] == markers
        if is_same.all() and np.sum(labels >= 0) == len(points):  # no label differs now
            self._check.put_off(alternative.renaming)
            return None
        labeller.begin(frame.points_m, labels, is_confident)
        observation = Observation.of_points(self._by_marker(frame.points_m, labels))
        moved_m = np.linalg.norm(observation.points_m - pose.observed_m, axis=1)[self._torso]
        keeps_torso = bool(np.any(moved_m < _SAME_M) and not np.any(moved_m >= _SAME_M))
        adds = bool(is_same.all() and len(points))
        return AlternativeLabels(
            observation, alternative.nearer, adds, keeps_torso, labeller, frame.time_s, alternative
        )

    def refute_alternative(self, alternative: AlternativeLabels) -> None:
        """Keep the current labels, because the alternative ones do not fit the body."""
        self._check.refute(alternative.alternative.renaming)

    def follow_alternative(self, alternative: AlternativeLabels) -> None:
        """Replace the current labels by the alternative ones."""
        check = self._check
        self.reset()
        self.labellings += 1
        self._labeller = alternative.labeller
        if alternative.adds:  # the evidence for relabelling other markers remains valid
            self._check = check
        self._check.begin(alternative.time_s)

    def expected(self, predicted_m: Array, elapsed_s: float) -> tuple[Array, Array]:
        """Return the expected marker positions (M, 3) and their uncertainty (M,), metres."""
        return self._labeller.expected(predicted_m, elapsed_s)

    def cost(self, frame: MarkerFrame, pose: PerformerPose) -> float:
        """Return the negative log likelihood of the labels with which a frame's pose was solved."""
        located = int(np.sum(np.isfinite(pose.observed_m[:, 0])))
        if located == 0:
            return _NOTHING_COST * min(len(frame.points_m), len(self._torso))
        cost = self._initial.cost(pose.observed_m, pose.markers_m, max(len(frame.points_m) - located, 0))
        return cost + 0.5 * located * (float(np.fmin(pose.marker_rms_m, _UNFIT_M)) / _FIT_M) ** 2

    def label_initially(self, points_m: Array) -> InitialLabels | None:
        """Return labels of points (N, 3) without history, or None if the points do not look like a body."""
        return self._initial.label(points_m)

    def label(self, frame: MarkerFrame, predicted_m: Array | None, elapsed_s: float) -> Observation:
        """Return the labelled markers of the next frame.

        Args:
            predicted_m: Markers (M, 3) of the last pose; None without history.
        """
        self.searched = predicted_m is None and not is_labelled(frame)
        if is_labelled(frame):
            return self._observe_known_labels(frame)
        if predicted_m is None:
            return Observation.of_points(self._by_marker(frame.points_m, self._search_labels(frame, elapsed_s)))
        return self.label_tracked(frame, predicted_m, elapsed_s)

    def label_tracked(self, frame: MarkerFrame, predicted_m: Array, elapsed_s: float) -> Observation:
        """Return the labelled markers of a frame of a tracked body, see `label`."""
        if not self._cameras or len(frame.blobs) != len(self._cameras):
            labels = self._labeller.label(frame.points_m, frame.covariances_m2, predicted_m, elapsed_s)
            return Observation.of_points(self._by_marker(frame.points_m, labels))
        found = self._labeller.label_blobs(frame, self._cameras, predicted_m, elapsed_s)
        single = found.single_cameras
        image_points = found.normalised[np.arange(len(self._torso)), single]
        image_points[single < 0] = np.nan
        return Observation(found.points_m, single, image_points, self._cameras)

    def _search_labels(self, frame: MarkerFrame, elapsed_s: float) -> IntArray:
        """Return labels (N,) found without history; all are -1 until the search has found some."""
        if self._search is None:
            self._search = LabelSearch(self._initial, frame.points_m, Labeller(self._torso))
        else:
            self._search.follow(frame.points_m, elapsed_s)
        labels = np.full(len(frame.points_m), -1)
        if self._search.advance(WORK_ALONE):
            if self._search.found is not None:
                self._labeller, labels = self._search.carry(self._search.found.labels)
                self.labellings += 1
                self._check.begin(frame.time_s, self._search.found)
            self._search = None
        return labels

    def _observe_known_labels(self, frame: MarkerFrame) -> Observation:
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
