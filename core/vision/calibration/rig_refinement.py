"""Refinement of calibrated cameras from markers, after a bump or for precision.

Any moving markers do, a performer's or a single one on a wand: with lenses known, points that several cameras see
determine the cameras' places up to scale (Hartley and Zisserman, Multiple View Geometry, 9 and 18.1), and the scale is
kept from the calibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from ...errors import CalibrationError
from ...geometry import rotations as rot
from ...geometry.arrays import Array, FloatArray
from ...geometry.camera import Camera, CameraRig
from ...geometry.triangulation import triangulate
from ..matching.stereo import StereoMatcher

_GATES_DEG = (3.0, 1.0, 0.4)  # a bumped camera's lines miss by degrees; each pass lets fewer wrong pairs in
# What markers do not tell stays as calibrated. They tell little of turns and shifts that almost make up for each other,
# and there what lenses and times leave over, which is alike for all markers of a place, would be taken for a bump.
_USUAL_BUMP = np.array([0.03, 0.03, 0.03, 0.02, 0.02, 0.02])  # turn (radians) and shift (m), one sigma
_SYSTEMATIC_PX = 0.3
_SURE = 0.02  # bones come out longer or shorter by about as much
_INDEPENDENT = 100.0  # so many markers are worth as much as all
_LEAST_POINTS = 200
_LEAST_FRAMES = 20
_ROBUST_PX = 0.5
_BUMPED_PX = 1.0  # matched markers of cameras that stand as calibrated miss each other by half of it
_BUMPED_FACTOR = 2.0


@dataclass(frozen=True)
class Refinement:
    """Cameras in their present places.

    Args:
        rig: with the first camera where it was, and the distance of the first two as it was.
        before_px, after_px: median distance in pixels of markers from where the cameras agree they are, with the old
            and the new places, over the same pairs of markers.
        turned_deg, moved_mm: (C,) how far each camera is from where it was thought to be.
        depth_sigma: standard deviation of the markers' places that the new cameras' uncertainty makes, as a fraction of
            their distance. Cameras close together see markers too alike to tell a turn towards each other.
    """

    rig: CameraRig
    before_px: float
    after_px: float
    turned_deg: Array
    moved_mm: Array
    depth_sigma: float
    points: int

    @property
    def bumped(self) -> bool:
        """Whether the cameras no longer stand as they were calibrated."""
        return self.before_px > max(_BUMPED_PX, _BUMPED_FACTOR * self.after_px)

    @property
    def sure(self) -> bool:
        """Whether the markers tell the new places well enough to measure with them."""
        return self.depth_sigma < _SURE


def refine_rig(rig: CameraRig, frames: Sequence[Sequence[FloatArray]]) -> Refinement:
    """Return the rig with the cameras placed as the markers tell.

    Args:
        rig: as calibrated; lenses are kept.
        frames: per moment and camera the blobs (n, 5), as `detect` gives them.

    Raises:
        CalibrationError: one camera only, or too few markers that several cameras see.
    """
    if len(rig) < 2:
        raise CalibrationError("one camera cannot be refined", advice="use the take of all cameras")
    found = rig
    focal = float(np.mean([camera.focal_px for camera in rig.cameras]))
    for gate in np.radians(_GATES_DEG) * focal:
        observed, weights, moments = _match_markers(found, frames, float(gate))
        if len(observed) < _LEAST_POINTS or len(np.unique(moments)) < _LEAST_FRAMES:
            raise CalibrationError(
                f"{len(observed)} markers at {len(np.unique(moments))} moments are seen by several cameras; "
                f"{_LEAST_POINTS} at {_LEAST_FRAMES} are needed",
                advice="move markers through the whole space before the cameras for half a minute, or calibrate again",
            )
        found, depth_sigma = _fit_cameras(found, observed, weights)
    return Refinement(
        found,
        _median_px(rig, observed, weights),
        _median_px(found, observed, weights),
        np.array([_angle_deg(old, new) for old, new in zip(rig.cameras, found.cameras, strict=True)]),
        np.array(
            [1000.0 * np.linalg.norm(a.centre_m - b.centre_m) for a, b in zip(rig.cameras, found.cameras, strict=True)]
        ),
        depth_sigma,
        len(observed),
    )


def _match_markers(
    rig: CameraRig, frames: Sequence[Sequence[FloatArray]], gate_px: float
) -> tuple[Array, Array, Array]:
    """Return matched points (N, C, 2), their weights (N, C) and moments (N,)."""
    matcher = StereoMatcher(rig, gate_px)
    observed, weights, moments = [], [], []
    for moment, blobs in enumerate(frames):
        normalised = matcher.undistort(blobs)
        table = matcher.match(blobs, normalised, None).blobs
        points = np.zeros((*table.shape, 2))
        for camera, coordinates in enumerate(normalised):
            seen = table[:, camera] >= 0
            points[seen, camera] = coordinates[table[seen, camera]]
        observed.append(points)
        weights.append((table >= 0).astype(np.float64))
        moments.append(np.full(len(table), moment))
    if not observed:
        return np.empty((0, len(rig), 2)), np.empty((0, len(rig))), np.empty(0)
    return np.concatenate(observed), np.concatenate(weights), np.concatenate(moments)


def _fit_cameras(rig: CameraRig, observed: Array, weights: Array) -> tuple[CameraRig, float]:
    """Move all cameras but the first so that rays meet; return rig and depth sigma."""
    seen = weights > 0.0
    usual = np.tile(_USUAL_BUMP, len(rig) - 1)

    def residuals(unknown: Array) -> Array:
        moved = _move_cameras(rig, unknown)
        points = triangulate(moved.cameras, observed, weights, 1.0)[0]
        rows = []
        for index, camera in enumerate(moved.cameras):
            local = camera.to_camera(points[seen[:, index]])
            rows.append((local[:, :2] / local[:, 2:] - observed[seen[:, index], index]) * camera.focal_px)
        errors = _soften(np.concatenate(rows).ravel() / _ROBUST_PX) * _ROBUST_PX / _SYSTEMATIC_PX
        return np.concatenate((errors * np.sqrt(_INDEPENDENT / len(observed)), unknown / usual))

    result = least_squares(residuals, np.zeros(len(usual)), bounds=(-10.0 * usual, 10.0 * usual), x_scale=usual)
    covariance = np.linalg.inv(result.jac.T @ result.jac)
    return _move_cameras(rig, result.x), _depth_sigma(rig, result.x, covariance, observed, weights)


def _depth_sigma(rig: CameraRig, found: Array, covariance: Array, observed: Array, weights: Array) -> float:
    points = triangulate(_move_cameras(rig, found).cameras, observed, weights, 1.0)[0]
    far = np.linalg.norm(points - rig.cameras[0].centre_m, axis=1)
    sizes, axes = np.linalg.eigh(covariance)
    squares = 0.0
    for size, axis in zip(sizes, axes.T, strict=True):
        step = 0.1 * np.sqrt(max(size, 0.0))  # a tenth of a deviation: points far off would not move in proportion
        other = triangulate(_move_cameras(rig, found + step * axis).cameras, observed, weights, 1.0)[0]
        squares += float(np.median(np.linalg.norm(other - points, axis=1) / far / 0.1)) ** 2
    return float(np.sqrt(squares))


def _soften(errors: Array) -> Array:
    """Return errors with soft L1 squares: unchanged when small, roots when large."""
    return np.asarray(np.sign(errors) * np.sqrt(2.0 * (np.sqrt(1.0 + errors**2) - 1.0)))


def _move_cameras(rig: CameraRig, unknown: Array) -> CameraRig:
    """Turn cameras but the first about their centres and move these."""
    first = rig.cameras[0]
    cameras: list[Camera] = [first]
    for index, (camera, step) in enumerate(zip(rig.cameras[1:], unknown.reshape(-1, 6), strict=True), start=1):
        rotation = rot.to_matrix(rot.from_rotation_vector(step[:3])) @ camera.rotation
        centre = camera.centre_m + step[3:]
        if index == 1:
            apart = centre - first.centre_m
            centre = first.centre_m + apart * rig.baseline_m() / np.linalg.norm(apart)
        cameras.append(replace(camera, rotation=rotation, translation_m=-rotation @ centre))
    return replace(rig, cameras=tuple(cameras))


def _median_px(rig: CameraRig, observed: Array, weights: Array) -> float:
    return float(np.median(triangulate(rig.cameras, observed, weights, 1.0)[2][weights > 0.0]))


def _angle_deg(old: Camera, new: Camera) -> float:
    return float(np.degrees(np.linalg.norm(rot.to_rotation_vector(rot.from_matrix(new.rotation @ old.rotation.T)))))
