"""Tracking of one prop from frame to frame, with search when it is lost.

Its distances are exact to millimetres, so points that may be its markers are few; placed on them, it must explain
the blobs of each camera, single ones too. A tracked prop starts at its expected pose instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.scene_pose import PropPose
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask
from ..geometry.camera import Camera
from ..geometry.point_patterns import match_rigid_pattern, place_pattern, planarity_m
from ..geometry.rigid_transform import transform
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_frame_subset import without_blobs, without_points
from ..markers.prop import LEAST_PLANARITY_M, Prop
from .prop_image_fit import Placed, PropImages

_FEWEST = 3  # markers that place a prop
_SPAN_M = 0.006  # distances between located markers may be off by this,
_SPAN_SIGMAS = 0.5  # and by this share of what the cameras' geometry says (it is said for poor centres)
_FIT_M = 0.010  # RMS distance beyond which points are not the prop
_MISSED_M = 0.03  # what it counts that a marker has no point
_TRIED = 6  # matches to lay it on points that are looked at
_ELSEWHERE_M = 0.03  # two places that put a marker further apart than this are different
_CLEARLY_M2 = 0.005**2  # of mean square: where no images tell, the best place must be better by this than another
_GATE_M = 0.10  # where a followed prop's markers are looked for: so far from the prediction,
_GATE_SPEED_SHARE = 0.5  # and this share of the predicted movement,
_GATE_LOST_M_S = 2.0  # and more the longer nothing was seen
_HELD_S = 0.25  # after which a prop that is not seen is lost, and found by its distances alone
_CLAIM_S = 0.10  # in which a prop that too little shows still claims what lies where its markers should be
_CLAIM_M = 0.03
_CONFIRMED_S = 0.10  # in which a find must last that chance may have made: by three markers, or
_SURE_BLOBS = 7  # by fewer blobs than this
_NEAR_PX = 4.0  # a blob this near to where a prop puts a marker may be the marker
_EXPECTED_PX = 20.0  # the same where the prop is expected
_FIT_PX = 1.5  # a blob further off than this from the prop in its best place is another's
_FEWEST_BLOBS = 5  # blobs that place it: a pose has six numbers, so these have four to spare
_LEAST_SCORE = 4.75  # so few must be within a third of a pixel
_WELL = 0.85  # of its blobs: a place that explains so much of enough of them is right
_CLEARLY = 0.7  # of a blob: by this much a place must explain more than any other


@dataclass(frozen=True)
class PropDetection:
    """Detection of a prop in one frame.

    Args:
        rest: the frame without what belongs to the prop.
    """

    pose: PropPose
    rest: MarkerFrame


@dataclass(frozen=True)
class _PoseCandidate:
    """Pose of a prop on points: point (M,) of each marker, -1 for none, and its error."""

    placed: Placed
    points: IntArray
    rms_m: float
    cost_m2: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """Pose of a prop in the images: blobs (M, C), and their number less their errors."""

    placed: Placed
    blobs: IntArray
    score: float

    @property
    def seen(self) -> int:
        """How many markers some camera shows."""
        return int(np.sum(np.any(self.blobs >= 0, axis=1)))

    @property
    def blob_count(self) -> int:
        """How many blobs are the prop's."""
        return int(np.sum(self.blobs >= 0))


class PropTracker:
    """Follows one prop through the frames of one capture.

    Args:
        cameras: that the frames' blobs refer to, if they have any.
    """

    def __init__(self, prop: Prop, cameras: Sequence[Camera] = ()) -> None:
        self.prop = prop
        self._cameras = tuple(cameras)
        self._last: Placed | None = None
        self._before: Placed | None = None
        self._pose = PropPose(rot.identity(), np.zeros(3))
        self._unconfirmed_since_s: float | None = None  # since when it has been where it may be by chance

    def step(self, frame: MarkerFrame) -> PropDetection:
        """Return the prop's pose in the next frame, and the frame without its markers."""
        if self._last is not None and not 0.0 <= frame.time_s - self._last.time_s <= _HELD_S:
            self._forget()
        expected = self._predict(frame.time_s)
        if self._cameras and len(frame.blobs) == len(self._cameras):
            return self._by_images(frame, expected)
        return self._by_points(frame, expected)

    def _by_points(self, frame: MarkerFrame, expected: Placed | None) -> PropDetection:
        candidates = self._candidates(frame, expected)
        if not candidates or any(
            other.cost_m2 - candidates[0].cost_m2 < _CLEARLY_M2
            and self._is_elsewhere(other.placed, candidates[0].placed)
            for other in candidates[1:]
        ):
            return self._miss(frame)
        taken = np.zeros(len(frame.points_m), dtype=bool)
        own = candidates[0].points[candidates[0].points >= 0]
        taken[own] = True
        return self._accept(
            candidates[0].placed, candidates[0].rms_m, len(own), len(own) > _FEWEST, without_points(frame, taken)
        )

    def _by_images(self, frame: MarkerFrame, expected: Placed | None) -> PropDetection:
        images = PropImages(self._cameras, frame, self.prop)
        found = self._find_places(frame, images, expected)
        if not found or any(found[0].score - other.score < _CLEARLY for other in found[1:]):
            return self._claim_blobs(frame, images, expected)
        best = found[0]
        sure = best.seen > _FEWEST and best.blob_count >= _SURE_BLOBS
        rest = _without_own(frame, best.blobs)
        return self._accept(best.placed, images.off_m(best.placed, best.blobs), best.seen, sure, rest)

    def _find_places(self, frame: MarkerFrame, images: PropImages, expected: Placed | None) -> list[_Fit]:
        """Return the different places that the images show the prop in, the best first."""
        found: list[_Fit] = []
        if expected is not None:
            fit = self._fit(images, expected, _EXPECTED_PX)
            if fit is not None and fit.blob_count >= _SURE_BLOBS and fit.score > _WELL * fit.blob_count:
                return [fit]
            found = [fit] if fit is not None else []
        for candidate in self._candidates(frame, expected):
            if any(not self._is_elsewhere(candidate.placed, known.placed) for known in found):
                continue
            fit = self._fit(images, candidate.placed, _NEAR_PX)
            if fit is not None:
                same = [known for known in found if not self._is_elsewhere(fit.placed, known.placed)]
                if all(known.score < fit.score for known in same):
                    found = [fit, *(known for known in found if known not in same)]
        return sorted(found, key=lambda fit: -fit.score)

    def _fit(self, images: PropImages, start: Placed, limit_px: float) -> _Fit | None:
        """Fit the prop to the images near a start; None when they do not show it."""
        placed, errors_px = start, np.empty(0)
        for limit in (limit_px, _NEAR_PX):
            blobs = images.nearest(placed, limit)
            if not self._is_placed_by(blobs):
                return None
            placed, errors_px = images.fit(placed, blobs)
        blobs = np.where(errors_px < _FIT_PX, blobs, -1)
        score = float(np.sum(1.0 - (errors_px[blobs >= 0] / _FIT_PX) ** 2))
        return _Fit(placed, blobs, score) if score >= _LEAST_SCORE and self._is_placed_by(blobs) else None

    def _is_placed_by(self, blobs: IntArray) -> bool:
        """Return whether blobs (M, C) suffice to place the prop."""
        return bool(np.sum(blobs >= 0) >= _FEWEST_BLOBS) and self._is_spread(np.any(blobs >= 0, axis=1))

    def _is_spread(self, seen: Mask) -> bool:
        """Return whether markers (M,) place the prop: three at least, not on a line."""
        return int(seen.sum()) >= _FEWEST and planarity_m(self.prop.positions_m[seen]) >= LEAST_PLANARITY_M

    def _is_elsewhere(self, one: Placed, other: Placed) -> bool:
        return bool(np.max(np.linalg.norm(one.markers(self.prop) - other.markers(self.prop), axis=1)) > _ELSEWHERE_M)

    def _candidates(self, frame: MarkerFrame, expected: Placed | None) -> list[_PoseCandidate]:
        """Return the best poses of the prop on points, near the expected one first."""
        points = frame.points_m
        if len(points) < _FEWEST:
            return []
        sigmas = np.sqrt(np.trace(frame.covariances_m2, axis1=1, axis2=2) / 3.0)
        tolerances = _SPAN_M + _SPAN_SIGMAS * (sigmas[:, None] + sigmas[None])
        if expected is not None and self._last is not None:
            markers = expected.markers(self.prop)
            moved = np.linalg.norm(markers - self._last.markers(self.prop), axis=1)
            gates = _GATE_M + _GATE_SPEED_SHARE * moved + _GATE_LOST_M_S * (expected.time_s - self._last.time_s)
            allowed = np.linalg.norm(points[:, None] - markers[None], axis=-1) < gates
            near = self._best_fits(
                points, match_rigid_pattern(points, self.prop.spans_m, tolerances, _FEWEST, allowed), frame
            )
            if near:
                return near
        found = self._best_fits(points, match_rigid_pattern(points, self.prop.spans_m, tolerances, _FEWEST), frame)
        # three points elsewhere may be so by chance, while the prop is only hidden
        return [candidate for candidate in found if expected is None or np.sum(candidate.points >= 0) > _FEWEST]

    def _best_fits(self, points_m: Array, matches: IntArray, frame: MarkerFrame) -> list[_PoseCandidate]:
        """Return the best few of the matches (H, M), the best first."""
        found: list[_PoseCandidate] = []
        for points in matches:
            known = points >= 0
            missed = float((~known).sum()) * _MISSED_M**2 / len(points)
            if len(found) >= _TRIED and missed > found[_TRIED - 1].cost_m2:
                break  # matches with fewer points follow
            if not self._is_spread(known):
                continue
            turn, shift, rms_m = place_pattern(self.prop.positions_m[known], points_m[points[known]])
            if rms_m < _FIT_M:
                cost_m2 = float(known.mean()) * rms_m**2 + missed
                found.append(_PoseCandidate(Placed(turn, shift, frame.time_s), points, rms_m, cost_m2))
                found.sort(key=lambda candidate: candidate.cost_m2)
        return found[:_TRIED]

    def _predict(self, time_s: float) -> Placed | None:
        """Return the expected pose, at constant velocity from the last two frames."""
        if self._last is None:
            return None
        last, before = self._last, self._before
        if before is None or last.time_s <= before.time_s:
            return Placed(last.turn, last.shift, time_s)
        share = (time_s - last.time_s) / (last.time_s - before.time_s)
        step = rot.to_rotation_vector(rot.from_matrix(last.turn @ before.turn.T))
        turn = rot.to_matrix(rot.from_rotation_vector(share * step)) @ last.turn
        # the middle of the markers moves steadily, the origin of a swung prop need not
        middle = self.prop.positions_m.mean(axis=0)
        now = transform(last.turn, last.shift, middle)
        then = transform(before.turn, before.shift, middle)
        return Placed(turn, now + share * (now - then) - turn @ middle, time_s)

    def _accept(self, placed: Placed, rms_m: float, seen: int, sure: bool, rest: MarkerFrame) -> PropDetection:
        if self._last is None:
            self._unconfirmed_since_s = placed.time_s
        if self._unconfirmed_since_s is not None and (
            sure or placed.time_s - self._unconfirmed_since_s >= _CONFIRMED_S
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
        """Return an unseen prop that for a moment keeps the blobs near its markers.

        Otherwise a performer with a hidden hand would get the sword's hilt.
        """
        rest = frame
        if expected is not None and self._last is not None and frame.time_s - self._last.time_s <= _CLAIM_S:
            rest = _without_own(frame, images.nearest(expected, images.pixels_of(expected, _CLAIM_M)))
        return self._miss(rest)

    def _miss(self, rest: MarkerFrame) -> PropDetection:
        if self._unconfirmed_since_s is not None:  # it was chance
            self._forget()
        return PropDetection(self.last_pose(), rest)

    def last_pose(self) -> PropPose:
        """Return where the prop was last, as not found."""
        return PropPose(self._pose.rotation, self._pose.position_m)

    def _forget(self) -> None:
        self._last = self._before = self._unconfirmed_since_s = None


def _without_own(frame: MarkerFrame, blobs: IntArray) -> MarkerFrame:
    """Return the frame without the blobs (M, C), -1 for none."""
    return without_blobs(frame, [column[column >= 0] for column in blobs.T])
