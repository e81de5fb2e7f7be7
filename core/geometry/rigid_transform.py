"""Rigid motions between point sets."""

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
    handedness = np.sign(np.linalg.det(vt.T @ u.T))
    rotation: Array = vt.T @ np.diag([1.0, 1.0, handedness]) @ u.T
    return rotation, q_mean - rotation @ p_mean


def transform(rotation: ArrayLike, translation: ArrayLike, points: ArrayLike) -> Array:
    """Return R p + t for points `[..., 3]`."""
    p = np.asarray(points, dtype=np.float64)
    return np.asarray(p @ np.asarray(rotation, dtype=np.float64).T + np.asarray(translation, dtype=np.float64))
