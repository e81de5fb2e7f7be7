"""Tracking one prop from frame to frame, with a search when it is lost.

The distances between a prop's markers are exact to millimetres, so only few points can be these markers. A prop placed
on such points must explain the blobs of each camera, including those that only one camera sees. For a tracked prop, the
fit starts from its expected pose instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..body.scene_pose import PropPose
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask
from ..geometry.camera import Camera
from ..geometry.point_patterns import match_rigid_pattern, place_pattern, planarity_m
from ..geometry.rigid_transform import transform
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_frame_subset import without_blobs, without_points
from ..markers.prop import FEWEST_MARKERS, RULES, Prop
from .prop_image_fit import Placed, PropImages


@dataclass(frozen=True)
class PropSettings:
    """Settings of `PropTracker`, tuned on a simulated sword among a performer's markers.

    A pose has six degrees of freedom, so five blobs (ten coordinates) leave four to spare. The score of a blob is 1 -
    (error / `fit_px`)^2; that of a pose is the sum over its blobs.
    """

    span_m: float = 0.006  # tolerance of distances between located markers
    span_sigmas: float = 0.5  # additional tolerance as a share of the points' standard deviations, which are too large
    fit_m: float = 0.010  # RMS distance above which points are not the prop's markers
    missed_m: float = 0.03  # distance assumed for a marker without a point
    tried: int = 6  # largest number of matches with points from which poses are fitted to the images
    elsewhere_m: float = 0.03  # distance of a marker above which two poses are different
    clearly_m2: float = 0.005**2  # smallest lead of the best pose in mean squared distance, without images
    gate_m: float = 0.10  # largest distance of a tracked prop's markers from their predicted positions
    gate_speed_share: float = 0.5  # growth of this gate, as a share of the predicted movement
    gate_hidden_m_s: float = 2.0  # growth of this gate per second that the prop has been hidden
    held_s: float = 0.25  # time after which a hidden prop is lost
    claim_s: float = 0.10  # time for which a poorly visible prop keeps the blobs at its predicted markers
    claim_m: float = 0.03  # largest distance of these blobs from the markers
    confirmed_s: float = 0.10  # time that a detection by three markers or few blobs, perhaps by chance, must last
    sure_blobs: int = 7  # number of blobs from which a detection is not by chance
    near_px: float = 4.0  # largest distance of a blob from a marker of a candidate pose
    expected_px: float = 20.0  # the same for a marker of the expected pose
    fit_px: float = 1.5  # error above which a blob does not belong to the prop
    fewest_blobs: int = 5  # fewest blobs that determine the pose
    least_score: float = 4.75  # smallest score of a pose; five blobs reach it with errors below a third of a pixel
    well_explained: float = 0.85  # score per blob above which a pose fitted from the expected one is accepted
    clearly: float = 0.7  # smallest lead of a pose in score over any other


_S = PropSettings()


@dataclass(frozen=True)
class PropDetection:
    """Detection of a prop in one frame."""

    pose: PropPose
    rest: MarkerFrame  # the frame without the points and blobs of the prop


class _PoseCandidate(NamedTuple):
    """Pose of a prop, fitted to points."""

    placed: Placed
    points: IntArray  # (M,) point of each marker, -1 for none
    rms_m: float
    cost_m2: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """Pose of a prop, fitted to the images."""

    placed: Placed
    blobs: IntArray  # (M, C), -1 for none
    score: float

    @property
    def seen(self) -> int:
        """Number of markers that any camera sees."""
        return int(np.sum(np.any(self.blobs >= 0, axis=1)))

    @property
    def blob_count(self) -> int:
        """Number of the prop's blobs."""
        return int(np.sum(self.blobs >= 0))


class PropTracker:
    """Tracks one prop through the frames of a capture.

    Args:
        cameras: Cameras of the frames' blobs; empty for frames that only have points.
    """

    def __init__(self, prop: Prop, cameras: Sequence[Camera] = ()) -> None:
        self.prop = prop
        self._cameras = tuple(cameras)
        self._last: Placed | None = None
        self._before: Placed | None = None
        self._pose = PropPose(rot.identity(), np.zeros(3))
        self._unconfirmed_since_s: float | None = None  # time of the first detection that may be by chance

    def step(self, frame: MarkerFrame) -> PropDetection:
        """Return the prop's pose in the next frame, with the frame without the prop's markers."""
        if self._last is not None and not 0.0 <= frame.time_s - self._last.time_s <= _S.held_s:
            self._forget()
        expected = self._predict(frame.time_s)
        if self._cameras and len(frame.blobs) == len(self._cameras):
            return self._by_images(frame, expected)
        return self._by_points(frame, expected)

    def _by_points(self, frame: MarkerFrame, expected: Placed | None) -> PropDetection:
        candidates = self._candidates(frame, expected)
        if not candidates:
            return self._miss(frame)
        best, *others = candidates
        close = (other for other in others if other.cost_m2 - best.cost_m2 < _S.clearly_m2)
        if any(self._is_elsewhere(other.placed, best.placed) for other in close):
            return self._miss(frame)
        own = best.points[best.points >= 0]
        rest = without_points(frame, np.isin(np.arange(len(frame.points_m)), own))
        return self._accept(best.placed, best.rms_m, len(own), len(own) > FEWEST_MARKERS, rest)

    def _by_images(self, frame: MarkerFrame, expected: Placed | None) -> PropDetection:
        images = PropImages(self._cameras, frame, self.prop)
        found = self._find_places(frame, images, expected)
        if not found or any(found[0].score - other.score < _S.clearly for other in found[1:]):
            return self._claim_blobs(frame, images, expected)
        best = found[0]
        sure = best.seen > FEWEST_MARKERS and best.blob_count >= _S.sure_blobs
        rest = _without_own(frame, best.blobs)
        return self._accept(best.placed, images.off_m(best.placed, best.blobs), best.seen, sure, rest)

    def _find_places(self, frame: MarkerFrame, images: PropImages, expected: Placed | None) -> list[_Fit]:
        """Return the different poses of the prop that the images may show, best first."""
        found: list[_Fit] = []
        if expected is not None:
            fit = self._fit(images, expected, _S.expected_px)
            if fit is not None and fit.blob_count >= _S.sure_blobs and fit.score > _S.well_explained * fit.blob_count:
                return [fit]
            found = [fit] if fit is not None else []
        for candidate in self._candidates(frame, expected):
            if any(not self._is_elsewhere(candidate.placed, known.placed) for known in found):
                continue
            fit = self._fit(images, candidate.placed, _S.near_px)
            if fit is not None:
                same = [known for known in found if not self._is_elsewhere(fit.placed, known.placed)]
                if all(known.score < fit.score for known in same):
                    found = [fit, *(known for known in found if known not in same)]
        return sorted(found, key=lambda fit: -fit.score)

    def _fit(self, images: PropImages, start: Placed, limit_px: float) -> _Fit | None:
        """Fit the prop to the images from a nearby start; None if they do not show it."""
        placed, errors_px = start, np.empty(0)
        for limit in (limit_px, _S.near_px):
            blobs = images.nearest(placed, limit)
            if not self._is_placed_by(blobs):
                return None
            placed, errors_px = images.fit(placed, blobs)
        blobs = np.where(errors_px < _S.fit_px, blobs, -1)
        score = float(np.sum(1.0 - (errors_px[blobs >= 0] / _S.fit_px) ** 2))
        return _Fit(placed, blobs, score) if score >= _S.least_score and self._is_placed_by(blobs) else None

    def _is_placed_by(self, blobs: IntArray) -> bool:
        """Return whether blobs (M, C) determine the prop's pose."""
        return bool(np.sum(blobs >= 0) >= _S.fewest_blobs) and self._is_spread(np.any(blobs >= 0, axis=1))

    def _is_spread(self, seen: Mask) -> bool:
        """Return whether markers (M,) determine the prop's pose: at least three, not on a line."""
        return int(seen.sum()) >= FEWEST_MARKERS and planarity_m(self.prop.positions_m[seen]) >= RULES.planarity_m

    def _is_elsewhere(self, one: Placed, other: Placed) -> bool:
        return bool(np.max(np.linalg.norm(one.markers(self.prop) - other.markers(self.prop), axis=1)) > _S.elsewhere_m)

    def _candidates(self, frame: MarkerFrame, expected: Placed | None) -> list[_PoseCandidate]:
        """Return the best poses of the prop on points; near the expected pose if there are any."""
        points = frame.points_m
        if len(points) < FEWEST_MARKERS:
            return []
        sigmas = np.sqrt(np.trace(frame.covariances_m2, axis1=1, axis2=2) / 3.0)
        tolerances = _S.span_m + _S.span_sigmas * (sigmas[:, None] + sigmas[None])
        if expected is not None and self._last is not None:
            markers = expected.markers(self.prop)
            moved = np.linalg.norm(markers - self._last.markers(self.prop), axis=1)
            gates = _S.gate_m + _S.gate_speed_share * moved + _S.gate_hidden_m_s * (expected.time_s - self._last.time_s)
            allowed = np.linalg.norm(points[:, None] - markers[None], axis=-1) < gates
            near = self._best_fits(frame, tolerances, allowed)
            if near:
                return near
        found = self._best_fits(frame, tolerances)
        # while the prop is hidden, three points elsewhere may match by chance
        return [candidate for candidate in found if expected is None or np.sum(candidate.points >= 0) > FEWEST_MARKERS]

    def _best_fits(self, frame: MarkerFrame, tolerances: Array, allowed: Mask | None = None) -> list[_PoseCandidate]:
        """Return the best few poses on matching points, best first; `allowed` (N, M) limits the matches."""
        points_m = frame.points_m
        matches = match_rigid_pattern(points_m, self.prop.spans_m, tolerances, FEWEST_MARKERS, allowed)
        found: list[_PoseCandidate] = []
        for points in matches:
            known = points >= 0
            missed = float((~known).sum()) * _S.missed_m**2 / len(points)
            if len(found) >= _S.tried and missed > found[_S.tried - 1].cost_m2:
                break  # matches with fewer points follow
            if not self._is_spread(known):
                continue
            turn, shift, rms_m = place_pattern(self.prop.positions_m[known], points_m[points[known]])
            if rms_m < _S.fit_m:
                cost_m2 = float(known.mean()) * rms_m**2 + missed
                found.append(_PoseCandidate(Placed(turn, shift, frame.time_s), points, rms_m, cost_m2))
                found.sort(key=lambda candidate: candidate.cost_m2)
        return found[: _S.tried]

    def _predict(self, time_s: float) -> Placed | None:
        """Return the expected pose, extrapolated at constant velocity from the last two."""
        if self._last is None:
            return None
        last, before = self._last, self._before
        if before is None or last.time_s <= before.time_s:
            return Placed(last.turn, last.shift, time_s)
        share = (time_s - last.time_s) / (last.time_s - before.time_s)
        step = rot.to_rotation_vector(rot.from_matrix(last.turn @ before.turn.T))
        turn = rot.to_matrix(rot.from_rotation_vector(share * step)) @ last.turn
        # the centre of the markers moves steadily; the origin of a swung prop may not
        middle = self.prop.positions_m.mean(axis=0)
        now = transform(last.turn, last.shift, middle)
        then = transform(before.turn, before.shift, middle)
        return Placed(turn, now + share * (now - then) - turn @ middle, time_s)

    def _accept(self, placed: Placed, rms_m: float, seen: int, sure: bool, rest: MarkerFrame) -> PropDetection:
        if self._last is None:
            self._unconfirmed_since_s = placed.time_s
        if self._unconfirmed_since_s is not None and (
            sure or placed.time_s - self._unconfirmed_since_s >= _S.confirmed_s
        ):
            self._unconfirmed_since_s = None
        self._before, self._last = self._last, placed
        if self._unconfirmed_since_s is not None:
            return PropDetection(self.last_pose(), rest)
        quaternion = rot.from_matrix(placed.turn)
        sign = 1.0 if np.dot(quaternion, self._pose.rotation) >= 0.0 else -1.0
        self._pose = PropPose(sign * quaternion, placed.shift, rms_m, seen)
        return PropDetection(self._pose, rest)

    def _claim_blobs(self, frame: MarkerFrame, images: PropImages, expected: Placed | None) -> PropDetection:
        """Mark the prop as not found, but let it keep the blobs near its expected markers for a moment.

        Otherwise a performer whose hand is hidden would get the blob on the sword's hilt.
        """
        rest = frame
        if expected is not None and self._last is not None and frame.time_s - self._last.time_s <= _S.claim_s:
            rest = _without_own(frame, images.nearest(expected, images.pixels_of(expected, _S.claim_m)))
        return self._miss(rest)

    def _miss(self, rest: MarkerFrame) -> PropDetection:
        if self._unconfirmed_since_s is not None:  # the detection was by chance
            self._forget()
        return PropDetection(self.last_pose(), rest)

    def last_pose(self) -> PropPose:
        """Return the prop's last pose, marked as not found."""
        return PropPose(self._pose.rotation, self._pose.position_m)

    def _forget(self) -> None:
        self._last = self._before = self._unconfirmed_since_s = None


def _without_own(frame: MarkerFrame, blobs: IntArray) -> MarkerFrame:
    """Return the frame without blobs (M, C) of the prop's markers."""
    return without_blobs(frame, [column[column >= 0] for column in blobs.T])
