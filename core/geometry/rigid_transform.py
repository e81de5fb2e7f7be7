"""Rigid transforms and principal axes fitted to points."""

import numpy as np
from numpy.typing import ArrayLike

from ..kernel.library import address, checked, contiguous, function, stage
from . import rotations as rot
from .arrays import Array

_HORN = np.zeros((3, 3, 4, 4))
for _first, _second, _third in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _HORN[_first, _first, range(4), range(4)] = -1.0
    _HORN[_first, _first, [0, 1 + _first], [0, 1 + _first]] = 1.0
    _HORN[_first, _second, [0, 1 + _third], [1 + _third, 0]] = 1.0
    _HORN[_second, _first, [0, 1 + _third], [1 + _third, 0]] = -1.0
    _HORN[[_first, _second], [_second, _first], 1 + _first, 1 + _second] = 1.0
    _HORN[[_first, _second], [_second, _first], 1 + _second, 1 + _first] = 1.0
_HORN = _HORN.reshape(9, 16)


def kabsch(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> tuple[Array, Array]:
    """Return R (3, 3) and t (3,) that minimise sum w |target - (R source + t)|^2.

    Args:
        source, target: Points (N, 3); three that are not on a line determine the rotation.
        weights: Non-negative weights (N,).
    """
    quaternion, translation = fit_rigid(source, target, weights)
    return rot.to_matrix(quaternion), translation


_FIT = function("fit_rigid", "npppp")


def _compiled(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> tuple[Array, Array]:
    p, fitted = np.ascontiguousarray(source, dtype=np.float64), np.empty(7)
    w = np.ones(len(p)) if weights is None else weights
    checked(_FIT(len(p), address(p), contiguous(target), contiguous(w), address(fitted)))
    return fitted[:4], fitted[4:]


@stage(_compiled)
def fit_rigid(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> tuple[Array, Array]:
    """Return the transform of `kabsch` with its rotation as a quaternion (Horn 1987)."""
    p = np.asarray(source, dtype=np.float64)
    q = np.asarray(target, dtype=np.float64)
    w = np.ones(len(p)) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w / np.add.reduce(w)
    p_mean, q_mean = w @ p, w @ q
    together = (w[:, None] * (p - p_mean)).T @ (q - q_mean)
    # q^T (matrix) q is the sum of w target (R source), so the rotation is the eigenvector of the largest eigenvalue
    _, vectors = np.linalg.eigh((together.ravel() @ _HORN).reshape(4, 4))
    quaternion: Array = vectors[:, 3]
    if quaternion[0] < 0.0:
        quaternion = -quaternion
    return quaternion, q_mean - rot.to_matrix(quaternion) @ p_mean


def mean_vertical(template: Array, targets: Array, fewest: int) -> Array:
    """Return the mean (3,) of the template's y axis in rigid fits to targets; zero if no target can be fitted.

    Args:
        template: Points (N, 3) of an upright body.
        targets: Points (F, N, 3), NaN where unknown.
        fewest: Smallest number of known points in a target that can be fitted.
    """
    ups: list[Array] = []
    for target in targets:
        known = np.isfinite(target[:, 0])
        if known.sum() >= fewest:
            ups.append(kabsch(template[known], target[known])[0][:, 1])
    return np.mean(ups, axis=0) if ups else np.zeros(3)


def transform(rotation: ArrayLike, translation: ArrayLike, points: ArrayLike) -> Array:
    """Return R p + t for points (..., 3)."""
    p = np.asarray(points, dtype=np.float64)
    return np.asarray(p @ np.asarray(rotation, dtype=np.float64).T + np.asarray(translation, dtype=np.float64))


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotation nearest to an almost orthogonal matrix (3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


def principal_axes(points: Array) -> tuple[Array, Array, Array]:
    """Return the centroid of points (N, 3), their extents (3,) and principal axes (3, 3).

    An extent is the square root of the summed squares along an axis. The axes are rows, longest first; the last is the
    normal of the nearest plane.
    """
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle)
    return middle, sizes, axes


def rigid_misfits_m2(source: Array, targets: Array) -> Array:
    """Return the mean squared distances (F,) of points from their rigid fits to targets.

    Args:
        source: Points (N, 3).
        targets: Points (F, N, 3), NaN where unknown; three or more are known in each row.
    """
    known = np.isfinite(targets[..., 0])
    weights = known / known.sum(axis=1, keepdims=True)
    q = np.where(known[..., None], targets, 0.0)
    p = source - np.einsum("fn,nc->fc", weights, source)[:, None]
    q = q - np.einsum("fn,fnc->fc", weights, q)[:, None]
    together = np.einsum("fn,fni,fnj->fij", weights, p, q).reshape(len(q), 9)
    largest = np.linalg.eigvalsh((together @ _HORN).reshape(-1, 4, 4))[:, 3]
    squares = np.einsum("fn,fnc,fnc->f", weights, p, p) + np.einsum("fn,fnc,fnc->f", weights, q, q)
    return np.asarray(np.maximum(squares - 2.0 * largest, 0.0))
