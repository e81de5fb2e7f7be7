"""Labelling points by the markers of the last solved pose.

Chai and Hodgins 2005, section 4.1: markers are labelled in the first frame; the points of later frames are matched to
the markers of the last solved pose. That pose also predicts hidden markers, so a marker that returns gets its label
back.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from ..geometry.camera import Camera
from ..geometry.gated_assignment import assign
from ..geometry.triangulation import triangulate
from ..markers.marker_frame import MarkerFrame, undistort_blobs
from .marker_tracks import SETTINGS, Tracks, expected_markers, located_tracks


@dataclass(frozen=True)
class LabellerSettings:
    """Settings of `Labeller`, tuned on takes with crossing limbs and returning markers (tuning log).

    A marker takes a point within a gate around its predicted position. A limb marker that was hidden may return farther
    away: it takes a point that no other marker can have and that has stayed in place for some frames, because false
    matches between two cameras do not last.
    """

    lone_reach_m: float = 1.0  # distance within which a hidden marker takes a point that only it can have
    lone_frames: int = 3  # number of frames for which such a point must have stayed in place
    lone_move_m: float = 0.1  # largest movement in one frame of a point that stays in place
    pixel_sigma: float = 0.5  # standard deviation of blob centres
    meeting_px: float = 3.0  # reprojection error above which rays are not of the same marker


_S = LabellerSettings()


@dataclass(frozen=True)
class LabelledBlobs:
    """Blobs of M markers in C cameras, and the points triangulated from them."""

    blobs: IntArray  # (M, C) indices, -1 where the camera does not show the marker
    normalised: Array  # (M, C, 2) undistorted normalised coordinates, NaN where there is no blob
    points_m: Array  # (M, 3) positions of markers that two or more cameras see, NaN for other markers

    @property
    def single_cameras(self) -> IntArray:
        """The only camera (M,) that sees each marker; -1 if none does or the marker is located."""
        shown = self.blobs >= 0
        alone = np.any(shown, axis=1) & ~np.isfinite(self.points_m[:, 0])
        return np.where(alone, np.argmax(shown, axis=1), -1)


class Labeller:
    """Labels the points of successive frames in one capture.

    Args:
        torso: Markers (M,) on the torso. If the torso is located, they are reliable even after being hidden for long.
    """

    def __init__(self, torso: Mask) -> None:
        self._torso, count = np.asarray(torso), len(torso)
        self._tracks = Tracks.unknown(count)
        # unlabelled points (M, 3) that only this marker can have, NaN if none, and for how many frames they have stayed
        self._lone_m, self._lone_frames = np.full((count, 3), np.nan), np.zeros(count, dtype=np.int64)

    def begin(self, points_m: Array, labels: IntArray, is_confident: Mask | None = None) -> None:
        """Start from labels (N,) of points (N, 3).

        Args:
            is_confident: Markers (M,) that are assumed to be tracked confidently; none by default.
        """
        confident = np.zeros_like(self._torso) if is_confident is None else is_confident.copy()
        self._tracks = located_tracks(self._tracks, points_m, labels, 0.0)._replace(is_confident=confident)

    @property
    def is_confident(self) -> Mask:
        """Markers (M,) that have been tracked confidently since the last `confirm`."""
        return self._tracks.is_confident.copy()

    def confirm(self, markers: Mask) -> None:
        """Treat the last frame's labels of these markers (M,) as certain."""
        certain = self._tracks.is_confident | (markers & (self._tracks.hidden_s == 0.0))
        self._tracks = self._tracks._replace(is_confident=certain)

    def label(self, points_m: Array, covariances_m2: Array, predicted_m: Array, elapsed_s: float) -> IntArray:
        """Return labels (N,) from a single assignment of points to the predicted markers.

        Args:
            points_m: Points (N, 3).
            covariances_m2: Their covariances (N, 3, 3).
            predicted_m: Markers (M, 3) of the last pose.
            elapsed_s: Time since that pose.
        """
        labels = np.full(len(points_m), -1, dtype=np.int64)
        expected, gates = self.expected(predicted_m, elapsed_s)
        tracked = self._tracks.hidden_s == 0.0
        rows, columns = assign_points(points_m, covariances_m2, expected, gates, tracked)
        labels[rows] = columns
        rows, columns = self._lone_points(points_m, np.flatnonzero(labels < 0), expected, columns)
        labels[rows] = columns
        self._tracks = located_tracks(self._tracks, points_m, labels, elapsed_s)
        return labels

    def follow(self, points_m: Array, elapsed_s: float) -> IntArray:
        """Return labels (N,) from the markers' last positions, without a solved pose."""
        known = np.flatnonzero(np.isfinite(self._tracks.positions_m[:, 0]))
        expected, gates = self.expected(self._tracks.positions_m, elapsed_s)
        rows, columns = assign_points(points_m, np.zeros((len(points_m), 3, 3)), expected[known], gates[known])
        labels = np.full(len(points_m), -1, dtype=np.int64)
        labels[rows] = known[columns]
        self._tracks = located_tracks(self._tracks, points_m, labels, elapsed_s)
        return labels

    def label_blobs(
        self, frame: MarkerFrame, cameras: Sequence[Camera], predicted_m: Array, elapsed_s: float
    ) -> LabelledBlobs:
        """Label the blobs in each image by the predicted markers, then triangulate the markers.

        Blobs of two markers on one epipolar line can be matched crosswise between the cameras without any
        contradiction. So each image is labelled by itself: the known body shows where each marker is in it.
        """
        frame = undistort_blobs(frame, cameras)
        expected, gates = self.expected(predicted_m, elapsed_s)
        tracked = self._tracks.hidden_s == 0.0
        count = len(expected)
        blobs = np.full((count, len(cameras)), -1, dtype=np.int64)
        distances = np.full((count, len(cameras)), np.inf)
        for index, camera in enumerate(cameras):
            rows, columns, shares = assign_blobs(frame.blobs[index], camera, expected, gates, tracked)
            blobs[columns, index] = rows
            distances[columns, index] = shares
        gates[self._take_lone_points(frame, blobs, expected)] = _S.lone_reach_m
        normalised = np.full((count, len(cameras), 2), np.nan)
        for index in range(len(cameras)):
            shown = blobs[:, index] >= 0
            normalised[shown, index] = frame.normalised[index][blobs[shown, index]]
        known = np.full((count, 3), np.nan)  # points that were triangulated from the same blobs
        if len(frame.points_m) and frame.point_blobs.shape[1] == len(cameras):
            markers, same = np.nonzero(np.all(blobs[:, None] == frame.point_blobs[None], axis=2))
            known[markers] = frame.points_m[same]
        points = _join_cameras(cameras, blobs, normalised, distances, expected, gates, known)
        labels = np.where(np.isfinite(points[:, 0]), np.arange(count), -1)
        self._tracks = located_tracks(self._tracks, points, labels, elapsed_s)
        return LabelledBlobs(blobs, normalised, points)

    def _take_lone_points(self, frame: MarkerFrame, blobs: IntArray, expected_m: Array) -> IntArray:
        """Give the blobs of lone points to hidden markers, in place in `blobs` (M, C); return these markers."""
        if len(frame.points_m) == 0 or frame.point_blobs.shape[1] != blobs.shape[1]:
            return np.empty(0, dtype=np.int64)
        shown = frame.point_blobs >= 0
        is_taken = np.any((blobs[:, None] == frame.point_blobs) & shown, axis=(0, 2))
        labelled = np.flatnonzero(np.any(blobs >= 0, axis=1))
        points, markers = self._lone_points(frame.points_m, np.flatnonzero(~is_taken), expected_m, labelled)
        blobs[markers] = frame.point_blobs[points]
        return markers

    def _lone_points(
        self, points_m: Array, points: IntArray, expected_m: Array, labelled: IntArray
    ) -> tuple[IntArray, IntArray]:
        """Return pairs (points, markers) that have been each other's only choice for some frames.

        Args:
            points: Indices of the unlabelled points among all points (N, 3).
            expected_m: Expected markers (M, 3).
            labelled: Indices of the markers that have a point.
        """
        is_free, hidden_s = ~self._torso, self._tracks.hidden_s
        is_free[labelled] = False
        free = np.flatnonzero(is_free)
        if len(points) == 0 or len(free) == 0:
            self._lone_frames[:] = 0
            return points[:0], free[:0]
        near = np.linalg.norm(points_m[points][:, None] - expected_m[free], axis=-1) < _S.lone_reach_m
        near &= near.sum(axis=0) == 1
        rows, columns = np.nonzero(near & (near.sum(axis=1, keepdims=True) == 1))
        hidden = (hidden_s[free[columns]] >= SETTINGS.memory_s) | (self._lone_frames[free[columns]] > 0)
        points, markers = points[rows[hidden]], free[columns[hidden]]
        stays = np.linalg.norm(points_m[points] - self._lone_m[markers], axis=-1) < _S.lone_move_m
        frames = np.where(stays, self._lone_frames[markers] + 1, 1)
        self._lone_m[:], self._lone_frames[:] = np.nan, 0
        self._lone_m[markers], self._lone_frames[markers] = points_m[points], frames
        stayed = frames > _S.lone_frames
        return points[stayed], markers[stayed]

    def expected(self, predicted_m: Array, elapsed_s: float) -> tuple[Array, Array]:
        """Return the expected markers (M, 3) and their gates (M,), metres; see `expected_markers`."""
        return expected_markers(self._tracks, self._torso, predicted_m, elapsed_s)


def assign_points(
    points_m: Array, covariances_m2: Array, expected_m: Array, gates_m: Array, first: Mask | None = None
) -> tuple[IntArray, IntArray]:
    """Return indices of the points and of the markers to which they are assigned.

    Args:
        points_m: Points (N, 3).
        covariances_m2: Their covariances (N, 3, 3).
        expected_m: Expected markers (M, 3).
        gates_m: Largest distances (M,) from the expected positions.
        first: Markers (M,) that choose first; by default all choose together.
    """
    deviation = np.sqrt(np.trace(covariances_m2, axis1=1, axis2=2) / 3.0)
    distances = np.linalg.norm(points_m[:, None] - expected_m[None], axis=-1)
    return _assign_in_order((distances / (gates_m[None] + 2.0 * deviation[:, None])) ** 2, first)


def assign_blobs(
    blobs: FloatArray, camera: Camera, expected_m: Array, gates_m: Array, first: Mask | None = None
) -> tuple[IntArray, IntArray, Array]:
    """Return indices of the blobs of one image and of their markers, and their distances as shares of the gates.

    Args:
        blobs: Rows (n, 5) of a `MarkerFrame`; the other arguments are those of `assign_points`.
    """
    pixels = blobs[:, :2].astype(np.float64)
    depth = np.maximum(camera.to_camera(expected_m)[:, 2], 0.1)
    with np.errstate(invalid="ignore"):
        distances = np.linalg.norm(pixels[:, None] - camera.project(expected_m)[None], axis=-1)
    limits = gates_m * camera.focal_px / depth
    costs = (np.where(np.isnan(distances), np.inf, distances) / limits[None]) ** 2
    rows, columns = _assign_in_order(costs, first)
    return rows, columns, distances[rows, columns] / limits[columns]


def _assign_in_order(costs: Array, first: Mask | None) -> tuple[IntArray, IntArray]:
    """Return rows and columns of the best assignment with costs (N, M), some columns (M,) first.

    Tracked markers come first: in a joint assignment a hidden marker's wide gate would take their points.
    """
    if first is None or first.all():
        return assign(costs)
    rows, columns = assign(np.where(first, costs, np.inf))
    left = costs.copy()
    left[rows] = np.inf
    left[:, columns] = np.inf
    further_rows, further_columns = assign(left)
    return np.concatenate((rows, further_rows)), np.concatenate((columns, further_columns))


def _join_cameras(
    cameras: Sequence[Camera],
    blobs: IntArray,
    normalised: Array,
    distances: Array,
    expected: Array,
    gates: Array,
    known: Array,
) -> Array:
    """Return triangulated markers (M, 3); where rays do not meet, the least likely blob is removed, in place."""
    points = np.full((len(blobs), 3), np.nan)
    while True:
        seen = blobs >= 0
        several = np.flatnonzero((seen.sum(axis=1) >= 2) & ~np.isfinite(points[:, 0]))
        if len(several) == 0:
            return points
        weights = seen[several].astype(np.float64)
        found, _, errors = triangulate(cameras, normalised[several], weights, _S.pixel_sigma, known[several])
        away = np.linalg.norm(found - expected[several], axis=1)
        good = errors.max(axis=1, where=seen[several], initial=0.0) < _S.meeting_px
        good &= away < gates[several]
        points[several[good]] = found[good]
        for marker in several[~good]:
            worst = int(np.argmax(np.where(seen[marker], distances[marker], -1.0)))
            blobs[marker, worst] = -1
            normalised[marker, worst] = np.nan
            known[marker] = np.nan
