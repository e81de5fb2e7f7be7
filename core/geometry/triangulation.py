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
    rotations = np.array([camera.rotation for camera in cameras])
    if start_m is not None and np.all(np.isfinite(start_m)):
        points = start_m
    else:
        points = _linear(cameras, rotations, observed, weights)
        if start_m is not None:
            points = np.where(np.isfinite(start_m), start_m, points)
    shifts = np.array([camera.translation_m for camera in cameras])
    focal = np.array([camera.focal_px for camera in cameras])
    # pixel units: the distortion changes the scale by little over a marker's error
    scale = (weights * (focal / pixel_sigma))[..., None]
    for steps_left in range(_GAUSS_NEWTON_STEPS, -1, -1):
        residual, jacobian = _residuals(rotations, shifts, points, observed, scale)
        rows = jacobian.reshape(len(points), -1, 3)
        across = rows.transpose(0, 2, 1)
        covariances = inverse_3x3(across @ rows)
        step = (covariances @ (across @ residual.reshape(len(points), -1, 1)))[..., 0]
        if steps_left == 0 or np.abs(step).max(initial=0.0) < _SMALL_STEP_M:
            break
        points = points - step
    errors = np.sqrt(np.sum(residual**2, axis=2)) * pixel_sigma
    return points, covariances, errors


def _linear(cameras: Sequence[Camera], rotations: Array, observed: Array, weights: Array) -> Array:
    """Point nearest to all rays, in the least-squares sense."""
    centres = np.array([camera.centre_m for camera in cameras])
    local = np.ones((*weights.shape, 3))
    local[..., :2] = observed
    rays = (local[:, :, None] @ rotations)[:, :, 0]  # as long as `local`
    squares = np.einsum("nci,nci->nc", local, local)
    weighted = rays * (weights / squares)[..., None]
    # sum of w (1 - r r^T) on the left, of w (1 - r r^T) c on the right, with r as a unit vector
    across = weights.sum(axis=1)[:, None, None] * np.eye(3) - weighted.transpose(0, 2, 1) @ rays
    along = np.einsum("nci,ci->nc", rays, centres)
    right = weights @ centres - np.einsum("nci,nc->ni", weighted, along)
    return np.asarray((inverse_3x3(across) @ right[..., None])[..., 0])


# elements of a flat symmetric matrix, of which cofactors 00, 01, 02, 11, 12, 22 are p * q - r * s
_P, _Q, _R, _S = np.array(((4, 2, 1, 0, 1, 0), (8, 5, 5, 8, 2, 4), (5, 1, 2, 2, 0, 1), (5, 8, 4, 2, 5, 1)))
_WHOLE = np.array((0, 1, 2, 1, 3, 4, 2, 4, 5))  # cofactors as flat matrices


def inverse_3x3(matrices: Array) -> Array:
    """Return the inverses of symmetric matrices (N, 3, 3) by cofactors.

    For a dozen of them NumPy's general solver spends its time on starting threads.
    """
    flat = matrices.reshape(-1, 9)
    cofactors = flat.take(_P, axis=1) * flat.take(_Q, axis=1) - flat.take(_R, axis=1) * flat.take(_S, axis=1)
    determinants = np.einsum("nk,nk->n", flat[:, :3], cofactors[:, :3])
    return (cofactors / determinants[:, None]).take(_WHOLE, axis=1).reshape(-1, 3, 3)


def _residuals(rotations: Array, shifts: Array, points: Array, observed: Array, scale: Array) -> tuple[Array, Array]:
    """Return scaled errors (N, C, 2) and their derivatives by the point (N, C, 2, 3)."""
    local = (points @ rotations.reshape(-1, 3).T).reshape(len(points), -1, 3) + shifts
    depth = local[..., 2:]
    depth = np.where(np.abs(depth) > 1e-6, depth, 1e-6)
    projected = local[..., :2] / depth
    residual = (projected - observed) * scale
    jacobian = rotations[:, :2] - projected[..., None] * rotations[:, 2:]
    jacobian *= (scale / depth)[..., None]
    return residual, jacobian


def depths(camera: Camera, points: Array) -> Array:
    """Return the distance (N,) of points (N, 3) along the camera's axis."""
    return np.asarray(points @ camera.rotation[2] + camera.translation_m[2])
