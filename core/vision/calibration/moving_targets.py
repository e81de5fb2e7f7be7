"""Things that move before cameras and calibrate them: a person who walks, a waved marker, a waved stick."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np

from ...body.calibration_poses import standing
from ...body.standard_skeleton import DEFAULT_HEIGHT_M, default_skeleton
from ...errors import CalibrationError
from ...geometry.arrays import Array, IntArray, median_of_known
from ...geometry.camera import Camera
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import MarkerSet
from ..matching.stereo import epipolar_distances, essential_matrix
from ..people.side_exchanges import SideExchanges
from .point_bundle import PointBundle, Sightings


@dataclass(frozen=True)
class TargetSettings:
    """Settings of the targets."""

    least_visible: float = 0.1  # probability of being visible below which a point of a person is not used
    independent_s: float = 0.7  # time after which a body network's errors are independent: they last 0.2 to 0.5 s
    alike: float = 2.0  # number of points on a joint that count fully; the errors of many are alike
    bone_sigma_m: float = 0.01  # change of the distance of a person's points on one bone
    stick_sigma_m: float = 0.001  # the same for two markers on a stick
    marker_sigma_px: float = 0.3  # standard deviation of a marker's centre, with time and lens errors
    middle_sigma_px: float = 3.0  # distance of the middle of a stick's two markers in an image from its own middle
    # distance from ears to ankles of a person as tall as the default body, relative to that body's: the mean of the CMU
    # subjects 03 to 16
    usual_length: float = 0.99
    height_sigma: float = 0.03  # relative error of a size from a known height: proportions, shoes, the network's points
    usual_height_sigma: float = 0.06  # the same for an unknown height
    speed_s: float = 0.05  # velocities are measured over this time before and after
    step_s: float = 0.1  # shortest time between moments that are used
    most_moments: int = 200  # largest number of moments that are used


_S = TargetSettings()
# bones whose ends a body network finds, without the sides
_BONES = (
    ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "heel"),
    ("ankle", "foot_index"), ("heel", "foot_index"), ("shoulder", "hip"), ("wrist", "index"), ("wrist", "pinky"),
    ("wrist", "thumb"), ("index", "pinky"),
)  # fmt: skip
_ACROSS = ("shoulder", "hip", "ear")  # pairs of points at a constant distance
_FACE = ("nose", "left_eye", "right_eye", "mouth_left", "mouth_right")  # points at a constant distance from the ears
# points from the ears to the ankles, whose distances along the body are a constant share of the height; those of the
# trunk are halfway between left and right
_TRUNK, _LEG = ("ear", "shoulder", "hip"), ("hip", "knee", "ankle")


@dataclass(frozen=True)
class PointTracks:
    """Points of one target in the images of C cameras.

    Args:
        times_s: Times (F,), increasing.
        pixels: Points (F, C, K, 2), NaN where not seen.
        sigmas_px: Standard deviations (F, C, K).
    """

    times_s: Array
    pixels: Array
    sigmas_px: Array

    def normalised(self, cameras: Sequence[Camera]) -> Array:
        """Return undistorted normalised coordinates (F, C, K, 2)."""
        return np.stack([camera.undistort(self.pixels[:, c]) for c, camera in enumerate(cameras)], axis=1)

    def reordered(self, rows: IntArray) -> "PointTracks":
        """Return the tracks with the points (F, C, K) of these numbers."""
        pixels = np.take_along_axis(self.pixels, rows[..., None], axis=2)
        return replace(self, pixels=pixels, sigmas_px=np.take_along_axis(self.sigmas_px, rows, axis=2))

    def sampled(self, independent_s: float, bones: IntArray, bone_sigma_m: float) -> Sightings:
        """Return the points at moments that are evenly spread and a step apart at least."""
        frame_s = float(np.median(np.diff(self.times_s)))
        ahead = max(1, round(_S.speed_s / frame_s))
        velocities = np.zeros(self.pixels.shape)
        spans_s = self.times_s[2 * ahead :] - self.times_s[: -2 * ahead]
        velocities[ahead:-ahead] = (self.pixels[2 * ahead :] - self.pixels[: -2 * ahead]) / spans_s[:, None, None, None]
        step = max(1, round(_S.step_s / frame_s), -(-len(self.times_s) // _S.most_moments))
        rows = np.arange(0, len(self.times_s), step)
        return Sightings(
            self.times_s[rows],
            self.pixels[rows],
            np.nan_to_num(velocities[rows]),
            self.sigmas_px[rows],
            bones,
            bone_sigma_m,
            min(1.0, step * frame_s / independent_s) if independent_s else 1.0,
        )


class MovingTarget(Protocol):
    """Interface of targets.

    Attributes:
        scale_sigma: Relative standard deviation of the sizes that the target gives.
    """

    scale_sigma: float

    def sightings(self, cameras: Sequence[Camera] | None = None) -> Sightings:
        """Return the points that cameras saw; with roughly known poses (in metres) the same points in all of them."""

    def scale(self, bundle: PointBundle) -> float:
        """Return how much larger everything is than in a bundle."""


class WalkingPerson:
    """A person whom a body network found.

    Args:
        tracks: Points of the network, in its order.
        points: The network's points.
        height_m: Height of the person, None if unknown.
    """

    def __init__(self, tracks: PointTracks, points: MarkerSet, height_m: float | None) -> None:
        self._tracks, self._markers = tracks, points.markers
        self.scale_sigma = _S.usual_height_sigma if height_m is None else _S.height_sigma
        self._row = {name: row for row, name in enumerate(points.names)}
        self.bones = np.array([[self._row[a], self._row[b]] for a, b in _pairs() if {a, b} <= self._row.keys()])
        skeleton = default_skeleton(height_m or DEFAULT_HEIGHT_M)
        self._length_m = _S.usual_length * self._chain_m(points.positions_on(skeleton, standing(skeleton))[None])

    def sightings(self, cameras: Sequence[Camera] | None = None) -> Sightings:
        """Return the points; with cameras, left and right as they agree."""
        tracks = self._tracks
        if cameras is not None:
            exchanges = SideExchanges(cameras, self._markers, judges=False)
            tracks = tracks.reordered(exchanges.decide_all(tracks.times_s, tracks.normalised(cameras)))
        return tracks.sampled(_S.independent_s, self.bones, _S.bone_sigma_m)

    def scale(self, bundle: PointBundle) -> float:
        """Return the ratio of the usual distance from ears to ankles, along the body, to that in a bundle."""
        seen = bundle.sightings.seen.any(axis=1)
        found_m = self._chain_m(np.where(seen[..., None], bundle.points_m, np.nan))
        if not found_m > 0.0:
            what = "two cameras never see the person's ears, shoulders, hips, knees and ankles together"
            raise CalibrationError(what, advice="walk where both see the whole body")
        return self._length_m / found_m

    def _chain_m(self, points_m: Array) -> float:
        """Return the distance from ears to ankles along the body, the mean of both legs, over points (F, K, 3)."""
        left, right = (
            {name: points_m[:, self._row[f"{side}_{name}"]] for name in (*_TRUNK, *_LEG)} for side in ("left", "right")
        )
        trunk = [0.5 * (left[name] + right[name]) for name in _TRUNK]
        legs = [[side[name] for name in _LEG] for side in (left, right)]
        bones = [np.linalg.norm(a - b, axis=-1) for chain in (trunk, *legs) for a, b in pairwise(chain)]
        lengths_m = median_of_known(np.stack(bones, axis=1))
        return float(lengths_m[:2].sum() + 0.5 * lengths_m[2:].sum())


def _pairs() -> list[tuple[str, str]]:
    """Return the names of points on one bone."""
    sides = ("left", "right")
    limbs = [(f"{side}_{a}", f"{side}_{b}") for side in sides for a, b in _BONES]
    crossed = [("left_shoulder", "right_hip"), ("right_shoulder", "left_hip")]
    face = [(f"{side}_ear", name) for side in sides for name in _FACE]
    return [*limbs, *((f"left_{name}", f"right_{name}") for name in _ACROSS), *crossed, *face]


def person_tracks(frames: Sequence[MarkerFrame], points: MarkerSet) -> PointTracks:
    """Return the points of a person from frames of `PeoplePipeline.detect`.

    Points that are likely to be hidden get larger standard deviations, as do many points on one joint.
    """
    joints = [marker.joint for marker in points.markers]
    alike = np.sqrt(np.maximum(1.0, np.array([joints.count(joint) for joint in joints]) / _S.alike))
    empty = np.full((len(points), 5), np.nan)
    rows = np.array([[each if len(each) == len(points) else empty for each in frame.blobs] for frame in frames])
    visible = rows[..., 3] / 255.0
    pixels = np.where((visible >= _S.least_visible)[..., None], rows[..., :2], np.nan)
    sigmas = np.where(np.isfinite(pixels[..., 0]), rows[..., 2] * alike / np.maximum(visible, _S.least_visible), 1.0)
    return PointTracks(np.array([frame.time_s for frame in frames]), pixels.astype(np.float64), sigmas)


class WavedStick:
    """A marker, or two markers on a stick, waved through the room.

    Args:
        tracks: One point or two; a camera's numbers of the two may differ from another's.
        length_m: Distance between the two markers.
        apart_m: Distance between the first two cameras, for one marker.
    """

    scale_sigma = 0.0

    def __init__(self, tracks: PointTracks, length_m: float = 0.0, apart_m: float = 0.0) -> None:
        self._tracks, self._length_m, self._apart_m = tracks, length_m, apart_m
        self.bones = np.array([[0, 1]]) if length_m else np.empty((0, 2), dtype=np.int64)

    def sightings(self, cameras: Sequence[Camera] | None = None) -> Sightings:
        """Return the points; without cameras, of a stick its middle only, because its ends are not known yet."""
        tracks = self._tracks
        if self._length_m and cameras is None:
            middle = tracks.pixels.mean(axis=2, keepdims=True)
            tracks = replace(tracks, pixels=middle, sigmas_px=np.full(middle.shape[:3], _S.middle_sigma_px))
            return tracks.sampled(0.0, np.empty((0, 2), dtype=np.int64), 1.0)
        if self._length_m and cameras is not None:
            tracks = tracks.reordered(self._ends(cameras))
        return tracks.sampled(0.0, self.bones, _S.stick_sigma_m)

    def scale(self, bundle: PointBundle) -> float:
        """Return the ratio of the known length to that in a bundle; 1 if the bundle does not show the stick's ends."""
        if not self._length_m:
            return self._apart_m / float(np.linalg.norm(bundle.cameras[1].translation_m))
        return self._length_m / float(bundle.bones_m[0]) if len(bundle.bones_m) else 1.0

    def _ends(self, cameras: Sequence[Camera]) -> IntArray:
        """Return the points (F, C, 2) so that the ends agree with those of the first camera that sees them."""
        points = self._tracks.normalised(cameras)
        rows = np.tile(np.arange(2), (*points.shape[:2], 1))
        reference = np.isfinite(points[..., 0, 0]).argmax(axis=1)
        for frame, first in enumerate(reference.tolist()):
            for c in range(first + 1, len(cameras)):
                if np.isfinite(points[frame, c, 0, 0]):
                    essential = essential_matrix(cameras[first], cameras[c])
                    apart = epipolar_distances(essential, 1.0, points[frame, first], points[frame, c])
                    if apart[0, 1] + apart[1, 0] < apart[0, 0] + apart[1, 1]:
                        rows[frame, c] = (1, 0)
        return rows


def marker_tracks(frames: Sequence[MarkerFrame], count: int) -> PointTracks:
    """Return the blobs of images that show as many as there are markers, one or two; each keeps its place in a row."""
    pixels = np.full((len(frames), len(frames[0].blobs), count, 2), np.nan)
    last: dict[int, Array] = {}
    for row, frame in enumerate(frames):
        for camera, blobs in enumerate(frame.blobs):
            if len(blobs) == count:
                found = blobs[:, :2].astype(np.float64)
                before = last.get(camera, found)
                if np.linalg.norm(found[::-1] - before) < np.linalg.norm(found - before):
                    found = found[::-1]
                pixels[row, camera] = last[camera] = found
    return PointTracks(
        np.array([frame.time_s for frame in frames]), pixels, np.full(pixels.shape[:3], _S.marker_sigma_px)
    )
