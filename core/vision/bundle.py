"""Bundle adjustment of cameras and board poses together (Triggs et al., "Bundle adjustment: a modern synthesis", 2000).

Against OpenCV's stereo calibration it adds the skew of the pixel grid and any number of cameras.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

INTRINSICS = 10
"""fx, fy, cx, cy, skew, k1, k2, p1, p2, k3 of one camera, in this order."""

_POSE = 6
_ITERATIONS = 100
_SMALLEST_GAIN = 1e-8
_LARGEST_DAMPING = 1e10


@dataclass(frozen=True)
class Sighting:
    """Board points (n, 3) seen as pixels (n, 2) by one camera at one moment."""

    camera: int
    moment: int
    points_m: Array
    pixels: Array


@dataclass(frozen=True)
class Bundle:
    """Unknowns: `intrinsics` (C, 10); `cameras` (C, 6) camera-from-first and `boards` (M, 6) first-camera-from-board,
    each a rotation vector and a translation; the first camera's is zero.
    """

    intrinsics: Array
    cameras: Array
    boards: Array


def matrix_of(intrinsics: Array) -> Array:
    """Return the (3, 3) camera matrix, skew included."""
    fx, fy, cx, cy, skew = intrinsics[:5]
    return np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def intrinsics_of(matrix: Array, distortion: Array) -> Array:
    """Return the (10,) intrinsics of a matrix and five distortion coefficients."""
    head = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], matrix[0, 1]]
    return np.concatenate((head, np.ravel(distortion)[:5]))


def adjust(start: Bundle, sightings: Sequence[Sighting], free: NDArray[np.bool_]) -> Bundle:
    """Return the bundle that minimises the squared reprojection error (Levenberg-Marquardt).

    Args:
        start: where to begin; intrinsics that are not free stay at their values.
        sightings: what was seen.
        free: (10,) which intrinsics of every camera are adjusted.
    """
    active = _active(start, free)
    current, damping = start, 1e-4
    cost, normal, gradient = _normal_equations(current, sightings)
    for _ in range(_ITERATIONS):
        a, g = normal[np.ix_(active, active)], gradient[active]
        step = np.zeros(len(gradient))
        step[active] = -np.linalg.lstsq(a + damping * np.diag(np.diag(a)), g, rcond=None)[0]
        candidate = _moved(current, step)
        new_cost, new_normal, new_gradient = _normal_equations(candidate, sightings)
        if not new_cost < cost:
            damping *= 10.0
            if damping > _LARGEST_DAMPING:
                break
            continue
        gain = (cost - new_cost) / cost
        current, cost, normal, gradient = candidate, new_cost, new_normal, new_gradient
        damping = max(damping / 10.0, 1e-12)
        if gain < _SMALLEST_GAIN:
            break
    return current


def adjust_boards(bundle: Bundle, sightings: Sequence[Sighting]) -> Bundle:
    """Return the bundle with only the boards' poses adjusted: how well a calibration explains pictures."""
    moments = sorted({sighting.moment for sighting in sightings})
    boards = bundle.boards.copy()
    for moment in moments:
        rows = [replace(s, moment=0) for s in sightings if s.moment == moment]
        single = replace(bundle, boards=boards[moment : moment + 1])
        boards[moment] = _adjust_one_board(single, rows)
    return replace(bundle, boards=boards)


def _adjust_one_board(bundle: Bundle, sightings: Sequence[Sighting]) -> Array:
    first = len(bundle.intrinsics) * (INTRINSICS + _POSE)
    damping = 1e-4
    cost, normal, gradient = _normal_equations(bundle, sightings)
    for _ in range(30):
        a = normal[first:, first:]
        step = np.zeros(len(gradient))
        step[first:] = -np.linalg.lstsq(a + damping * np.diag(np.diag(a)), gradient[first:], rcond=None)[0]
        candidate = _moved(bundle, step)
        new_cost, new_normal, new_gradient = _normal_equations(candidate, sightings)
        if not new_cost < cost:
            damping *= 10.0
            if damping > _LARGEST_DAMPING:
                break
            continue
        done = (cost - new_cost) / cost < _SMALLEST_GAIN
        bundle, cost, normal, gradient = candidate, new_cost, new_normal, new_gradient
        damping = max(damping / 10.0, 1e-12)
        if done:
            break
    return np.asarray(bundle.boards[0])


def residuals(bundle: Bundle, sighting: Sighting) -> Array:
    """Return predicted minus seen pixels (n, 2)."""
    return _residuals_and_jacobian(bundle, sighting)[0]


def rms_by_moment(bundle: Bundle, sightings: Sequence[Sighting]) -> Array:
    """Return the RMS reprojection error (M, C) in pixels, NaN where a camera did not see the board."""
    table = np.full((len(bundle.boards), len(bundle.intrinsics)), np.nan)
    for sighting in sightings:
        errors = residuals(bundle, sighting)
        table[sighting.moment, sighting.camera] = np.sqrt(np.mean(np.sum(errors**2, axis=1)))
    return table


def rms(bundle: Bundle, sightings: Sequence[Sighting]) -> float:
    """Return the RMS distance in pixels over all points."""
    squares = [np.sum(residuals(bundle, sighting) ** 2, axis=1) for sighting in sightings]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _active(bundle: Bundle, free: NDArray[np.bool_]) -> NDArray[np.int64]:
    cameras, moments = len(bundle.intrinsics), len(bundle.boards)
    mask = np.concatenate(
        (np.tile(free, cameras), np.repeat(np.arange(cameras) > 0, _POSE), np.ones(moments * _POSE, dtype=bool))
    )
    return np.flatnonzero(mask)


def _moved(bundle: Bundle, step: Array) -> Bundle:
    cameras = len(bundle.intrinsics)
    a, b = cameras * INTRINSICS, cameras * (INTRINSICS + _POSE)
    return Bundle(
        bundle.intrinsics + step[:a].reshape(-1, INTRINSICS),
        bundle.cameras + step[a:b].reshape(-1, _POSE),
        bundle.boards + step[b:].reshape(-1, _POSE),
    )


def _normal_equations(bundle: Bundle, sightings: Sequence[Sighting]) -> tuple[float, Array, Array]:
    cameras, moments = len(bundle.intrinsics), len(bundle.boards)
    size = cameras * (INTRINSICS + _POSE) + moments * _POSE
    normal, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
    for sighting in sightings:
        errors, jacobian = _residuals_and_jacobian(bundle, sighting)
        columns = np.concatenate(
            (
                sighting.camera * INTRINSICS + np.arange(INTRINSICS),
                cameras * INTRINSICS + sighting.camera * _POSE + np.arange(_POSE),
                cameras * (INTRINSICS + _POSE) + sighting.moment * _POSE + np.arange(_POSE),
            )
        )
        flat = errors.ravel()
        normal[np.ix_(columns, columns)] += jacobian.T @ jacobian
        gradient[columns] += jacobian.T @ flat
        cost += float(flat @ flat)
    return cost, normal, gradient


def _residuals_and_jacobian(bundle: Bundle, sighting: Sighting) -> tuple[Array, Array]:
    """Return errors (n, 2) and their derivatives (2n, 10 + 6 + 6) by intrinsics, camera pose and board pose."""
    intrinsics = bundle.intrinsics[sighting.camera]
    board, camera = bundle.boards[sighting.moment], bundle.cameras[sighting.camera]
    composed = cv2.composeRT(board[:3], board[3:], camera[:3], camera[3:])
    turn, shift = np.asarray(composed[0]), np.asarray(composed[1])
    by_board = np.block([[composed[2], composed[3]], [composed[6], composed[7]]])
    by_camera = np.block([[composed[4], composed[5]], [composed[8], composed[9]]])
    fx, fy, cx, cy, skew = intrinsics[:5]
    plain = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    projected, columns = cv2.projectPoints(
        np.ascontiguousarray(sighting.points_m, dtype=np.float64), turn, shift, plain, intrinsics[5:]
    )
    pixels, derivatives = np.asarray(projected, np.float64).reshape(-1, 2), np.asarray(columns, np.float64)
    height = (pixels[:, 1] - cy) / fy  # distorted y/z: what the skew acts on
    by_pose = derivatives[:, :6].copy()
    by_pose[0::2] += skew / fy * derivatives[1::2, :6]
    by_lens = derivatives[:, 10:15].copy()
    by_lens[0::2] += skew / fy * derivatives[1::2, 10:15]
    by_skew = np.zeros((len(by_pose), 1))
    by_skew[0::2, 0] = height
    jacobian = np.hstack((derivatives[:, 6:10], by_skew, by_lens, by_pose @ by_camera, by_pose @ by_board))
    errors = pixels - sighting.pixels
    errors[:, 0] += skew * height
    return errors, jacobian
