"""3D points from pixels of two or more cameras, with covariance."""

from collections.abc import Sequence

import numpy as np

from .arrays import Array
from .camera import Camera

_GAUSS_NEWTON_STEPS = 3
_SMALL_STEP_M = 1e-7


def triangulate(
    cameras: Sequence[Camera], normalised: Array, weights: Array, pixel_sigma: float, start_m: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return points (N, 3), covariances (N, 3, 3), pixel errors (N, C).

    The point minimises the reprojection error (Hartley and Zisserman, Multiple View Geometry, 12.3): linear start,
    then Gauss-Newton.

    Args:
        cameras: C calibrated cameras.
        normalised: (N, C, 2) undistorted normalised coordinates; ignored where the weight is zero.
        weights: (N, C) 1 where the camera sees the point, else 0; at least two ones in a row.
        pixel_sigma: standard deviation of a centre along each axis, pixels.
        start_m: (N, 3) where the points were found to be before, NaN where they were not.
    """
    observed = np.where(weights[..., None] > 0, normalised, 0.0)
    rotations = np.stack([camera.rotation for camera in cameras])
    if start_m is not None and np.all(np.isfinite(start_m)):
        points = start_m
    else:
        points = _linear(cameras, rotations, observed, weights)
        if start_m is not None:
            points = np.where(np.isfinite(start_m), start_m, points)
    shifts = np.stack([camera.translation_m for camera in cameras])
    focal = np.array([camera.focal_px for camera in cameras])
    # pixel units: the distortion changes the scale by little over a marker's error
    scale = weights * focal / pixel_sigma
    for steps_left in range(_GAUSS_NEWTON_STEPS, -1, -1):
        residual, jacobian = _residuals(rotations, shifts, points, observed, scale)
        across = jacobian.reshape(len(points), -1, 3).transpose(0, 2, 1)
        covariances = inverse_3x3(across @ across.transpose(0, 2, 1))
        step = (covariances @ (across @ residual.reshape(len(points), -1, 1)))[..., 0]
        if steps_left == 0 or np.max(np.abs(step), initial=0.0) < _SMALL_STEP_M:
            break
        points = points - step
    errors = np.sqrt(np.sum(residual**2, axis=2)) * pixel_sigma
    return points, covariances, errors


def _linear(cameras: Sequence[Camera], rotations: Array, observed: Array, weights: Array) -> Array:
    """Point nearest to all rays, in the least-squares sense."""
    centres = np.stack([camera.centre_m for camera in cameras])
    local = np.concatenate((observed, np.ones((*weights.shape, 1))), axis=2)
    rays = (local[:, :, None] @ rotations)[:, :, 0] / np.sqrt(np.sum(local * local, axis=2, keepdims=True))
    weighted = rays * weights[..., None]
    # sum of w (1 - r r^T) on the left, of w (1 - r r^T) c on the right
    across = np.sum(weights, axis=1)[:, None, None] * np.eye(3) - weighted.transpose(0, 2, 1) @ rays
    right = weights @ centres - np.sum(weighted * np.sum(rays * centres, axis=2, keepdims=True), axis=1)
    return np.asarray((inverse_3x3(across) @ right[..., None])[..., 0])


def inverse_3x3(matrices: Array) -> Array:
    """Return the inverses of symmetric matrices (N, 3, 3) by cofactors.

    For a dozen of them NumPy's general solver spends its time on starting threads.
    """
    a, b, c = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 0, 2]
    d, e, f = matrices[:, 1, 1], matrices[:, 1, 2], matrices[:, 2, 2]
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * c00 + b * c01 + c * c02
    result = np.empty_like(matrices)
    result[:, 0, 0], result[:, 1, 1], result[:, 2, 2] = c00, a * f - c * c, a * d - b * b
    result[:, 0, 1] = result[:, 1, 0] = c01
    result[:, 0, 2] = result[:, 2, 0] = c02
    result[:, 1, 2] = result[:, 2, 1] = b * c - a * e
    result /= determinant[:, None, None]
    return result


def _residuals(rotations: Array, shifts: Array, points: Array, observed: Array, scale: Array) -> tuple[Array, Array]:
    """Return scaled errors (N, C, 2) and their derivatives by the point (N, C, 2, 3)."""
    local = np.einsum("cij,nj->nci", rotations, points) + shifts
    depth = np.where(np.abs(local[..., 2]) > 1e-6, local[..., 2], 1e-6)
    projected = local[..., :2] / depth[..., None]
    residual = (projected - observed) * scale[..., None]
    rows = rotations[None, :, :2] - projected[..., None] * rotations[None, :, 2:3]
    jacobian = rows / depth[..., None, None] * scale[..., None, None]
    return residual, jacobian


def depths(camera: Camera, points: Array) -> Array:
    """Return the distance (N,) of points (N, 3) along the camera's axis."""
    return np.asarray(points @ camera.rotation[2] + camera.translation_m[2])
