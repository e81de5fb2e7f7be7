"""Labels of points by the markers of the last synthesized pose.

Chai and Hodgins 2005, section 4.1: markers are labelled in the first frame, later frames are matched to the marker set
of the most recent synthesized motion. That set includes hidden markers, so a marker that returns is labelled again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from ..geometry.camera import Camera
from ..geometry.gated_assignment import assign
from ..geometry.triangulation import triangulate
from ..markers.marker_frame import MarkerFrame, undistort_blobs

_GATE_M = 0.08  # plus what the marker moves in a frame
_GATE_SPEED_SHARE = 0.6  # of the predicted movement, by which the gate grows
_GATE_UNKNOWN_M_S = 6.0  # of a marker with a movement not known yet
_GATE_LOST_M_S = 2.0  # growth of the gate with the time that a marker has been lost
_GATE_MAX_M = 0.35
_GATE_TORSO_MAX_M = 0.12
# A limb's marker that was hidden may be further from where it is thought to be: it takes a point that is no other
# marker's choice, once this has been there for some frames; points that two cameras match wrongly come and go.
_REACH_M, _LONE_FRAMES, _LONE_M = 1.0, 3, 0.1
_PIXEL_SIGMA = 0.5
_MEETING_PX = 3.0  # reprojection error above which two rays do not belong to one marker
_MEMORY_S = 0.1  # a velocity older than this is not used
_BRIEFLY_S = 0.05  # a torso's marker hidden for no longer is as well known as one that is seen
_STEADY_M = 0.06  # from where it was going, within which a marker is surely followed if no other comes as near


@dataclass
class _Seen:
    """Where and how fast (NaN: unknown) each marker was when last located.

    Args:
        is_steady: (M,) whether it was where it was going.
        is_confident: (M,) whether it was followed without a doubt since all were known.
        lone_m, lone_frames: (M, 3), (M,) the point without a name that only this marker can be, and for how long.
    """

    positions_m: Array
    velocities_m_s: Array
    lost_s: Array
    is_steady: Mask
    is_confident: Mask
    lone_m: Array
    lone_frames: IntArray


@dataclass(frozen=True)
class LabelledBlobs:
    """Blobs of each marker, and the points that they give.

    Args:
        blobs: (M, C) blob index, -1 where the camera does not show the marker.
        normalised: (M, C, 2) undistorted normalised coordinates, NaN where not.
        points_m: (M, 3) position of markers that two or more cameras show, else NaN.
        covariances_m2: (M, 3, 3) its uncertainty.
    """

    blobs: IntArray
    normalised: Array
    points_m: Array
    covariances_m2: Array

    @property
    def single_cameras(self) -> IntArray:
        """(M,) the one camera that shows the marker, -1 where none or where it is located."""
        shown = self.blobs >= 0
        alone = np.any(shown, axis=1) & ~np.isfinite(self.points_m[:, 0])
        return np.where(alone, np.argmax(shown, axis=1), -1)


@dataclass(frozen=True)
class Priority:
    """Order of the markers (M,) when points or blobs are given to them.

    Args:
        tracked: seen in the last frame: they come first.
        torso: those of them on the torso.
        returning: of the torso, hidden briefly: they come first, too, where none of these may be.
    """

    tracked: Mask
    torso: Mask
    returning: Mask


class Labeller:
    """Labels the points of successive frames of one capture.

    Args:
        names: marker names, in the order of the marker set; labels are indices into them.
        torso: (M,) which of them lie on the torso: where it is known, so are they, even when hidden for long.
    """

    def __init__(self, names: Sequence[str], torso: Mask | None = None) -> None:
        self.names = tuple(names)
        self._torso = np.zeros(len(self.names), dtype=bool) if torso is None else np.asarray(torso)
        count = len(self.names)
        unknown = np.full((count, 3), np.nan)
        never, none = np.zeros(count, dtype=bool), np.zeros(count, dtype=np.int64)
        lost_s = np.full(count, np.inf)
        self._seen = _Seen(unknown, unknown.copy(), lost_s, never, never.copy(), unknown.copy(), none)

    def begin(self, points_m: Array, labels: IntArray, is_confident: Mask | None = None) -> None:
        """Start from labels (N,) of points (N, 3), -1 for none; `is_confident` (M,): no marker."""
        self._remember(points_m, labels, 0.0)
        self._seen.is_confident = np.zeros(len(self.names), dtype=bool) if is_confident is None else is_confident.copy()

    @property
    def is_confident(self) -> Mask:
        """(M,) markers followed without a doubt since the last `confirm`."""
        return self._seen.is_confident.copy()

    def confirm(self, markers: Mask) -> None:
        """Take the last frame's labels of these markers (M,) for certain."""
        self._seen.is_confident |= markers & (self._seen.lost_s == 0.0)

    def label(self, points_m: Array, covariances_m2: Array, predicted_m: Array, elapsed_s: float) -> IntArray:
        """Return labels (N,) by one assignment of points to the predicted markers.

        Args:
            points_m, covariances_m2: (N, 3) and (N, 3, 3) located points.
            predicted_m: (M, 3) markers of the last synthesized pose.
            elapsed_s: time since that pose.
        """
        labels = np.full(len(points_m), -1, dtype=np.int64)
        tracked = self._seen.lost_s == 0.0
        returning = self._torso & ~tracked & (self._seen.lost_s <= _BRIEFLY_S)
        priority = Priority(tracked, self._torso & tracked, returning)
        expected, gates = self.expected(predicted_m, elapsed_s)
        rows, columns = assign_points(points_m, covariances_m2, expected, gates, priority)
        labels[rows] = columns
        rows, columns = self._lone_points(points_m, np.flatnonzero(labels < 0), expected, columns)
        labels[rows] = columns
        self._remember(points_m, labels, elapsed_s)
        return labels

    def follow(self, points_m: Array, elapsed_s: float) -> IntArray:
        """Return labels (N,) by where the markers were last, without a body."""
        known = np.flatnonzero(np.isfinite(self._seen.positions_m[:, 0]))
        expected, gates = self.expected(self._seen.positions_m, elapsed_s)
        rows, columns = assign_points(points_m, np.zeros((len(points_m), 3, 3)), expected[known], gates[known])
        labels = np.full(len(points_m), -1, dtype=np.int64)
        labels[rows] = known[columns]
        self._remember(points_m, labels, elapsed_s)
        return labels

    def label_blobs(
        self, frame: MarkerFrame, cameras: Sequence[Camera], predicted_m: Array, elapsed_s: float
    ) -> "LabelledBlobs":
        """Label the blobs in each image by the predicted markers, then join the cameras.

        Two markers on one epipolar line can be matched crosswise between the cameras without contradiction; with the
        body known where they are in each image leaves no doubt.
        """
        frame = undistort_blobs(frame, cameras)
        expected, gates = self.expected(predicted_m, elapsed_s)
        tracked = self._seen.lost_s == 0.0
        # in an image a marker is hidden by what has come before it, so the nearest blob is hardly its own
        never = np.zeros_like(tracked)
        priority = Priority(tracked, never, never)
        count = len(expected)
        blobs = np.full((count, len(cameras)), -1, dtype=np.int64)
        normalised = np.full((count, len(cameras), 2), np.nan)
        strangeness = np.full((count, len(cameras)), np.inf)
        for index, camera in enumerate(cameras):
            rows, columns, shares = assign_blobs(frame.blobs[index], camera, expected, gates, priority)
            blobs[columns, index] = rows
            strangeness[columns, index] = shares
        gates[self._take_lone_points(frame, blobs, expected)] = _REACH_M
        for index in range(len(cameras)):
            shown = blobs[:, index] >= 0
            normalised[shown, index] = frame.normalised[index][blobs[shown, index]]
        known = _known_points(frame, blobs)
        points, covariances = _join_cameras(cameras, blobs, normalised, strangeness, expected, gates, known)
        self._remember(points, np.where(np.isfinite(points[:, 0]), np.arange(count), -1), elapsed_s)
        return LabelledBlobs(blobs, normalised, points, covariances)

    def _take_lone_points(self, frame: MarkerFrame, blobs: IntArray, expected_m: Array) -> IntArray:
        """Give blobs (M, C) of lone points to hidden markers, in place; return these."""
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
        """Return (points, markers) that are each other's only choice for some frames.

        Args:
            points: indices of the points (N, 3) without a name.
            expected_m: (M, 3) where each marker should be.
            labelled: markers that have a point.
        """
        seen, is_free = self._seen, ~self._torso
        is_free[labelled] = False
        free = np.flatnonzero(is_free)
        if len(points) == 0 or len(free) == 0:
            seen.lone_frames[:] = 0
            return points[:0], free[:0]
        near = np.linalg.norm(points_m[points][:, None] - expected_m[free], axis=-1) < _REACH_M
        near &= near.sum(axis=0) == 1
        rows, columns = np.nonzero(near & (near.sum(axis=1, keepdims=True) == 1))
        hidden = (seen.lost_s[free[columns]] >= _MEMORY_S) | (seen.lone_frames[free[columns]] > 0)
        points, markers = points[rows[hidden]], free[columns[hidden]]
        stays = np.linalg.norm(points_m[points] - seen.lone_m[markers], axis=-1) < _LONE_M
        frames = np.where(stays, seen.lone_frames[markers] + 1, 1)
        seen.lone_m[:], seen.lone_frames[:] = np.nan, 0
        seen.lone_m[markers], seen.lone_frames[markers] = points_m[points], frames
        stayed = frames > _LONE_FRAMES
        return points[stayed], markers[stayed]

    def expected(self, predicted_m: Array, elapsed_s: float) -> tuple[Array, Array]:
        """Return expected markers (M, 3) and their gates (M,), metres; see `label`.

        A marker that is lost goes on as it moved, for a short while; the pose may have left it at once.
        """
        is_known = np.isfinite(self._seen.velocities_m_s[:, 0])
        fresh = is_known & (self._seen.lost_s < _MEMORY_S)
        movement = np.where(fresh[:, None], self._seen.velocities_m_s * elapsed_s, 0.0)
        lost = np.where(np.isfinite(self._seen.lost_s), self._seen.lost_s, 1.0)
        gates = _GATE_M + _GATE_SPEED_SHARE * np.linalg.norm(movement, axis=1) + _GATE_LOST_M_S * lost
        gates += np.where(is_known, 0.0, _GATE_UNKNOWN_M_S * elapsed_s)
        lost_briefly = fresh & (self._seen.lost_s > 0.0) & self._seen.is_steady
        way = self._seen.positions_m + self._seen.velocities_m_s * self._seen.lost_s[:, None]
        predicted_m = np.where(lost_briefly[:, None], way, predicted_m)
        return predicted_m + movement, np.minimum(gates, np.where(self._torso, _GATE_TORSO_MAX_M, _GATE_MAX_M))

    def _remember(self, points_m: Array, labels: IntArray, elapsed_s: float) -> None:
        seen = self._seen
        located = labels >= 0
        markers, points = labels[located], points_m[located]
        self._update_confidence(points_m, labels, elapsed_s)
        if elapsed_s > 0.0:
            known = seen.lost_s[markers] < _MEMORY_S
            velocity = (points - seen.positions_m[markers]) / (elapsed_s + seen.lost_s[markers][:, None])
            seen.velocities_m_s[markers] = np.where(known[:, None], velocity, np.nan)
        seen.lost_s += elapsed_s
        seen.lost_s[markers] = 0.0
        seen.positions_m[markers] = points

    def _update_confidence(self, points_m: Array, labels: IntArray, elapsed_s: float) -> None:
        """Take markers for unsure that jumped, met others, or were lost."""
        seen, points = self._seen, np.flatnonzero(labels >= 0)
        markers = labels[points]
        gone_s = seen.lost_s + elapsed_s
        moving_s = np.where(gone_s < _MEMORY_S, gone_s, 0.0)
        expected = seen.positions_m + np.nan_to_num(seen.velocities_m_s) * moving_s[:, None]
        away = np.linalg.norm(points_m[:, None] - expected[None], axis=-1)
        away[np.isnan(away)] = np.inf
        own = away[points, markers]
        away[points, markers] = np.inf
        others = np.minimum(away.min(axis=1, initial=np.inf)[points], away.min(axis=0, initial=np.inf)[markers])
        steady = own < _STEADY_M
        seen.is_steady[markers] = steady
        seen.is_confident[markers] &= steady & (others > own + _STEADY_M)
        seen.is_confident &= gone_s < _MEMORY_S
        if 2 * np.sum(steady) <= len(steady):  # a cut, or a body that was hidden
            seen.is_confident[:] = False


def assign_points(
    points_m: Array, covariances_m2: Array, expected_m: Array, gates_m: Array, priority: Priority | None = None
) -> tuple[IntArray, IntArray]:
    """Return (points, markers) that belong together.

    Args:
        points_m, covariances_m2: (N, 3) and (N, 3, 3) located points.
        expected_m: (M, 3) where each marker should be.
        gates_m: (M,) how far off it may be.
        priority: which markers come first; default all.
    """
    deviation = np.sqrt(np.trace(covariances_m2, axis1=1, axis2=2) / 3.0)
    distances = np.linalg.norm(points_m[:, None] - expected_m[None], axis=-1)
    return _assign_by_priority((distances / (gates_m[None] + 2.0 * deviation[:, None])) ** 2, priority)


def assign_blobs(
    blobs: FloatArray, camera: Camera, expected_m: Array, gates_m: Array, priority: Priority | None = None
) -> tuple[IntArray, IntArray, Array]:
    """Return matching (blobs, markers) of one image, and distances as shares of gates.

    Args:
        blobs: (n, 5) as a `MarkerFrame` has them.
        expected_m, gates_m, priority: as of `assign_points`.
    """
    pixels = blobs[:, :2].astype(np.float64)
    depth = np.maximum(camera.to_camera(expected_m)[:, 2], 0.1)
    with np.errstate(invalid="ignore"):
        distances = np.linalg.norm(pixels[:, None] - camera.project(expected_m)[None], axis=-1)
    limits = gates_m * camera.focal_px / depth
    rows, columns = _assign_by_priority(
        (np.where(np.isnan(distances), np.inf, distances) / limits[None]) ** 2, priority
    )
    return rows, columns, distances[rows, columns] / limits[columns]


def _assign_by_priority(costs: Array, priority: Priority | None) -> tuple[IntArray, IntArray]:
    """Return rows and columns assigned: first those that come first.

    Together they would leave as few as possible over: a lost marker, allowed anywhere near, would push others aside.
    """
    if priority is None or priority.tracked.all():
        return assign(costs)
    first = np.flatnonzero(priority.tracked | priority.returning)
    own = costs[:, first]
    if priority.returning.any():
        is_taken = np.any(costs[:, priority.torso] < 1.0, axis=1)
        own = np.where(is_taken[:, None] & priority.returning[first], np.inf, own)
    rows, columns = assign(own)
    columns = first[columns]
    is_left, is_other = np.ones(len(costs), dtype=bool), np.ones(costs.shape[1], dtype=bool)
    is_left[rows], is_other[columns] = False, False
    left, others = np.flatnonzero(is_left), np.flatnonzero(is_other)
    further_rows, further_columns = assign(costs[np.ix_(left, others)])
    return np.concatenate((rows, left[further_rows])), np.concatenate((columns, others[further_columns]))


def _known_points(frame: MarkerFrame, blobs: IntArray) -> Array:
    """Return the frame's points (M, 3) of the same blobs (M, C), else NaN."""
    result = np.full((len(blobs), 3), np.nan)
    if len(frame.points_m) and frame.point_blobs.shape[1] == blobs.shape[1]:
        markers, points = np.nonzero(np.all(blobs[:, None] == frame.point_blobs[None], axis=2))
        result[markers] = frame.points_m[points]
    return result


def _join_cameras(
    cameras: Sequence[Camera],
    blobs: IntArray,
    normalised: Array,
    strangeness: Array,
    expected: Array,
    gates: Array,
    known: Array,
) -> tuple[Array, Array]:
    """Triangulate; if the rays disagree, remove the less likely blob, in place."""
    points, covariances = np.full((len(blobs), 3), np.nan), np.full((len(blobs), 3, 3), np.nan)
    while True:
        seen = blobs >= 0
        both = np.flatnonzero((seen.sum(axis=1) >= 2) & ~np.isfinite(points[:, 0]))
        if len(both) == 0:
            return points, covariances
        weights = seen[both].astype(np.float64)
        found, spread, errors = triangulate(cameras, normalised[both], weights, _PIXEL_SIGMA, known[both])
        away = np.linalg.norm(found - expected[both], axis=1)
        good = (errors.max(axis=1, where=seen[both], initial=0.0) < _MEETING_PX) & (away < gates[both])
        points[both[good]], covariances[both[good]] = found[good], spread[good]
        for marker in both[~good]:
            stranger = int(np.argmax(np.where(seen[marker], strangeness[marker], -1.0)))
            blobs[marker, stranger] = -1
            normalised[marker, stranger] = np.nan
            known[marker] = np.nan
