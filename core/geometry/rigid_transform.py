"""Fits of rigid transforms and axes to points."""

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array


def kabsch(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> tuple[Array, Array]:
    """Return R, t that minimise sum w |target - (R source + t)|^2 (Kabsch 1976).

    Args:
        source, target: (N, 3) points, N >= 3 and not all on a line for a unique rotation.
        weights: (N,) non-negative.
    """
    p = np.asarray(source, dtype=np.float64)
    q = np.asarray(target, dtype=np.float64)
    w = np.ones(len(p)) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w / w.sum()
    p_mean, q_mean = w @ p, w @ q
    u, _, vt = np.linalg.svd((w[:, None] * (p - p_mean)).T @ (q - q_mean))
    rotation: Array = (u @ vt).T
    if np.linalg.det(rotation) < 0.0:  # a mirror image
        u[:, 2] *= -1.0
        rotation = (u @ vt).T
    return rotation, q_mean - rotation @ p_mean


def transform(rotation: ArrayLike, translation: ArrayLike, points: ArrayLike) -> Array:
    """Return R p + t for points `[..., 3]`."""
    p = np.asarray(points, dtype=np.float64)
    return np.asarray(p @ np.asarray(rotation, dtype=np.float64).T + np.asarray(translation, dtype=np.float64))


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotation nearest to an almost orthogonal matrix (3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


def principal_axes(points: Array) -> tuple[Array, Array, Array]:
    """Fit axes to points (N, 3).

    Returns:
        The middle (3,), the root of the summed squares along each axis (3,), and the axes (3, 3) in rows, longest
        first: the last is the normal of the nearest plane.
    """
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle)
    return middle, sizes, axes
