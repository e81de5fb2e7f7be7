"""Refinement of calibrated cameras with markers, after a bump or for precision.

Any moving markers will do, a performer's or one on a wand: with known lenses, points that several cameras see determine
the cameras' poses up to scale (Hartley and Zisserman, Multiple View Geometry, 9 and 18.1). The scale is kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import CalibrationError, counted
from ...geometry import rotations as rot
from ...geometry.arrays import Array, FloatArray
from ...geometry.camera import Camera, CameraRig
from ...geometry.least_squares import NormalEquations, levenberg_marquardt
from ...geometry.triangulation import triangulate
from ..matching.stereo import StereoMatcher


@dataclass(frozen=True)
class RefinementSettings:
    """Settings for finding camera poses from markers."""

    # epipolar gates of successive passes: after a bump, epipolar lines miss by degrees; each pass admits fewer wrong
    # pairs
    gates_deg: tuple[float, ...] = (3.0, 1.0, 0.4)
    # Prior standard deviations of a bump, rotation (radians) and shift (m). Markers say little about rotations and
    # shifts that almost cancel; without a prior, systematic errors of lenses and times would be taken for such a bump.
    bump_sigmas: tuple[float, ...] = (0.03, 0.03, 0.03, 0.02, 0.02, 0.02)
    systematic_px: float = 0.3  # errors shared by all markers at the same place in the image
    independent: float = 100.0  # number of independent points that carry as much information as all correlated ones
    step: float = 1e-6  # step of finite differences, in standard deviations of a bump
    robust_px: float = 0.5  # scale of the soft L1 loss
    least_points: int = 200
    least_frames: int = 20
    # largest `depth_sigma` at which the refined rig is used; bone lengths then have about the same relative error
    sure: float = 0.02
    bumped_px: float = 1.0  # smallest error of moved cameras: twice the typical error of cameras that have not moved
    bumped_factor: float = 2.0  # smallest ratio of a moved camera's error before and after the refinement


_REFINEMENT = RefinementSettings()


@dataclass(frozen=True)
class Refinement:
    """Cameras with refined poses."""

    rig: CameraRig  # the first camera and the distance between the first two are unchanged
    before_px: float  # median reprojection error with the old poses
    after_px: float  # the same with the new poses
    turned_deg: Array  # (C,) rotation of each camera since the calibration
    moved_mm: Array  # (C,) shift of each camera since the calibration
    depth_sigma: float  # relative standard deviation of markers' distances due to the uncertainty of the camera poses
    points: int  # number of points used

    @property
    def bumped(self) -> bool:
        """Whether the cameras are no longer where they were calibrated."""
        return self.before_px > max(_REFINEMENT.bumped_px, _REFINEMENT.bumped_factor * self.after_px)

    @property
    def sure(self) -> bool:
        """Whether the new poses are good enough to measure with."""
        return self.depth_sigma < _REFINEMENT.sure


def refine_rig(rig: CameraRig, frames: Sequence[Sequence[FloatArray]]) -> Refinement:
    """Return the rig with camera poses found from markers; lenses are unchanged.

    Args:
        frames: Blobs (n, 5) of each camera at each moment.

    Raises:
        CalibrationError: There is only one camera, or too few markers are seen by several cameras.
    """
    if len(rig) < 2:
        raise CalibrationError(
            "refinement needs at least two cameras", advice="use a calibration and a take of several cameras"
        )
    found = rig
    focal = float(np.mean([camera.focal_px for camera in rig.cameras]))
    for gate in np.radians(_REFINEMENT.gates_deg) * focal:
        observed, weights, moments = _match_markers(found, frames, float(gate))
        if len(observed) < _REFINEMENT.least_points or len(np.unique(moments)) < _REFINEMENT.least_frames:
            raise CalibrationError(
                f"only {counted(len(observed), 'marker position')} at {counted(len(np.unique(moments)), 'moment')} "
                f"could be matched between cameras, but at least {_REFINEMENT.least_points} positions at "
                f"{_REFINEMENT.least_frames} moments are needed",
                advice="move markers through the cameras' whole view for half a minute, or calibrate again",
            )
        found, depth_sigma = _fit_cameras(found, observed, weights)
    before, after = (np.array([camera.rotation for camera in each.cameras]) for each in (rig, found))
    turned = rot.lengths(rot.to_rotation_vector(rot.from_matrix(after @ before.swapaxes(1, 2))))
    shifts_m = np.array([a.centre_m - b.centre_m for a, b in zip(rig.cameras, found.cameras, strict=True)])
    before_px, after_px = (
        float(np.median(triangulate(each.cameras, observed, weights, 1.0)[2][weights > 0.0])) for each in (rig, found)
    )
    return Refinement(
        found, before_px, after_px, np.degrees(turned), 1000.0 * rot.lengths(shifts_m), depth_sigma, len(observed)
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
    """Move all cameras except the first so that rays meet; return the rig and its `depth_sigma`."""
    seen = weights > 0.0
    usual = np.tile(_REFINEMENT.bump_sigmas, len(rig) - 1)
    scale = np.sqrt(_REFINEMENT.independent / len(observed)) * _REFINEMENT.robust_px / _REFINEMENT.systematic_px

    def residuals(unknown: Array) -> Array:
        moved = _move_cameras(rig, unknown)
        points = triangulate(moved.cameras, observed, weights, 1.0)[0]
        rows = []
        for index, camera in enumerate(moved.cameras):
            local = camera.to_camera(points[seen[:, index]])
            rows.append((local[:, :2] / local[:, 2:] - observed[seen[:, index], index]) * camera.focal_px)
        errors = np.concatenate(rows).ravel() / _REFINEMENT.robust_px
        # the squares of these errors are a soft L1 loss
        errors = np.sign(errors) * np.sqrt(2.0 * (np.sqrt(1.0 + errors**2) - 1.0))
        return np.concatenate((errors * scale, unknown / usual))

    def linearise(unknown: Array) -> NormalEquations:
        here, steps = residuals(unknown), np.diag(_REFINEMENT.step * usual)
        jacobian = np.stack([(residuals(unknown + step) - here) / step.sum() for step in steps], axis=1)
        return NormalEquations(jacobian.T @ jacobian, jacobian.T @ here, float(here @ here))

    def move(unknown: Array, step: Array) -> Array:
        return np.clip(unknown + step, -10.0 * usual, 10.0 * usual)

    found, near = levenberg_marquardt(np.zeros(len(usual)), linearise, move)
    covariance = np.linalg.inv(near.matrix)
    return _move_cameras(rig, found), _depth_sigma(rig, found, covariance, observed, weights)


def _depth_sigma(rig: CameraRig, found: Array, covariance: Array, observed: Array, weights: Array) -> float:
    points = triangulate(_move_cameras(rig, found).cameras, observed, weights, 1.0)[0]
    far = np.linalg.norm(points - rig.cameras[0].centre_m, axis=1)
    sizes, axes = np.linalg.eigh(covariance)
    squares = 0.0
    for size, axis in zip(sizes, axes.T, strict=True):
        # a tenth of a standard deviation, because distant points move in proportion only to small steps
        step = 0.1 * np.sqrt(max(size, 0.0))
        other = triangulate(_move_cameras(rig, found + step * axis).cameras, observed, weights, 1.0)[0]
        squares += float(np.median(np.linalg.norm(other - points, axis=1) / far / 0.1)) ** 2
    return float(np.sqrt(squares))


def _move_cameras(rig: CameraRig, unknown: Array) -> CameraRig:
    """Rotate all cameras but the first about their centres and shift them; `unknown` holds 6 numbers per camera."""
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
