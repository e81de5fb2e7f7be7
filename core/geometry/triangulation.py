"""Triangulation of points seen by two or more cameras, with covariances."""

from collections.abc import Sequence

import numpy as np

from .arrays import Array
from .camera import Camera
from .least_squares import gauss_newton


def triangulate(
    cameras: Sequence[Camera], normalised: Array, weights: Array, pixel_sigma: float, start_m: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return points (N, 3), covariances (N, 3, 3) and reprojection errors (N, C) in pixels.

    The points minimise the reprojection error (Hartley and Zisserman, Multiple View Geometry, 12.3).

    Args:
        normalised: Undistorted normalised coordinates (N, C, 2); ignored where the weight is zero.
        weights: 1 where a camera sees a point, else 0 (N, C); each point is seen by at least two.
        pixel_sigma: Standard deviation of a blob's centre along each axis, pixels.
        start_m: Earlier estimates of the points (N, 3), NaN if unknown.
    """
    observed = np.where(weights[..., None] > 0, normalised, 0.0)
    rotations = np.array([camera.rotation for camera in cameras])
    start = np.full((len(weights), 3), np.nan) if start_m is None else start_m
    if not np.all(np.isfinite(start)):
        start = np.where(np.isfinite(start), start, _linear(cameras, rotations, observed, weights))
    shifts = np.array([camera.translation_m for camera in cameras])
    focal = np.array([camera.focal_px for camera in cameras])
    # errors are converted to pixels by the focal length alone, because distortion is nearly constant over such short
    # distances
    scale = (weights * (focal / pixel_sigma))[..., None]
    points, residuals, jacobian = gauss_newton(
        start,
        lambda points: _residuals(rotations, shifts, points, observed, scale),
        steps=3,
        smallest=1e-7,  # metres
        solve=lambda matrices, vectors: (inverse_3x3(matrices) @ vectors[..., None])[..., 0],
    )
    errors = np.sqrt(np.sum(residuals.reshape(*weights.shape, 2) ** 2, axis=2)) * pixel_sigma
    return points, inverse_3x3(jacobian.swapaxes(1, 2) @ jacobian), errors


def _linear(cameras: Sequence[Camera], rotations: Array, observed: Array, weights: Array) -> Array:
    """Return the points (N, 3) nearest to their rays."""
    centres = np.array([camera.centre_m for camera in cameras])
    local = np.ones((*weights.shape, 3))
    local[..., :2] = observed
    rays = (local[:, :, None] @ rotations)[:, :, 0]
    squares = np.einsum("nci,nci->nc", local, local)
    weighted = rays * (weights / squares)[..., None]
    # normal equations, with unit rays r and centres c: the sum of w (1 - r r^T) times the point is the sum of w (1 - r
    # r^T) c
    across = weights.sum(axis=1)[:, None, None] * np.eye(3) - weighted.transpose(0, 2, 1) @ rays
    along = np.einsum("nci,ci->nc", rays, centres)
    right = weights @ centres - np.einsum("nci,nc->ni", weighted, along)
    return np.asarray((inverse_3x3(across) @ right[..., None])[..., 0])


# cofactors 00, 01, 02, 11, 12, 22 of a flat symmetric matrix are p * q - r * s of the entries at these indices
_P, _Q, _R, _S = np.array(((4, 2, 1, 0, 1, 0), (8, 5, 5, 8, 2, 4), (5, 1, 2, 2, 0, 1), (5, 8, 4, 2, 5, 1)))
_WHOLE = np.array((0, 1, 2, 1, 3, 4, 2, 4, 5))  # which of the six cofactors is at each entry of the flat matrix


def inverse_3x3(matrices: Array) -> Array:
    """Return the inverses of symmetric matrices (N, 3, 3) by cofactors.

    NumPy's general solver takes several times as long for a dozen matrices.
    """
    flat = matrices.reshape(-1, 9)
    cofactors = flat.take(_P, axis=1) * flat.take(_Q, axis=1) - flat.take(_R, axis=1) * flat.take(_S, axis=1)
    determinants = np.einsum("nk,nk->n", flat[:, :3], cofactors[:, :3])
    return (cofactors / determinants[:, None]).take(_WHOLE, axis=1).reshape(-1, 3, 3)


def _residuals(rotations: Array, shifts: Array, points: Array, observed: Array, scale: Array) -> tuple[Array, Array]:
    """Return scaled errors (N, 2 C) and their derivatives (N, 2 C, 3) with respect to the points."""
    local = (points @ rotations.reshape(-1, 3).T).reshape(len(points), -1, 3) + shifts
    depth = local[..., 2:]
    depth = np.where(np.abs(depth) > 1e-6, depth, 1e-6)
    projected = local[..., :2] / depth
    residual = (projected - observed) * scale
    jacobian = rotations[:, :2] - projected[..., None] * rotations[:, 2:]
    jacobian *= (scale / depth)[..., None]
    return residual.reshape(len(points), -1), jacobian.reshape(len(points), -1, 3)


def depths(camera: Camera, points: Array) -> Array:
    """Return the depths (...) of points (..., 3) along the camera's axis."""
    return np.asarray(points @ camera.rotation[2] + camera.translation_m[2])
