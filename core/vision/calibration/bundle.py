"""Bundle adjustment of cameras and board poses (Triggs et al., 2000).

Against OpenCV's stereo calibration it adds the skew of the pixel grid, any number of cameras, a prior of the
lenses, and cameras that did not take a moment's pictures at quite the same time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...geometry.arrays import Array, IntArray, Mask

INTRINSICS = 10
"""fx, fy, cx, cy, skew, k1, k2, p1, p2, k3 of one camera, in this order."""

CORNER_SIGMA_PX = 0.2
"""Standard deviation of a corner along each axis: what single cameras show on recorded boards."""

_POSE = 6
_ITERATIONS = 100
_SMALLEST_GAIN = 1e-8
_LARGEST_DAMPING = 1e10
_TIME_SIGMA_S = 0.05  # of a picture's time: cameras that are not synchronised are up to a frame or more apart


@dataclass(frozen=True)
class CornerObservation:
    """Board points (n, 3) seen as pixels (n, 2) by one camera at one moment.

    `motion_px_s` (n, 2) is how the pixels move, where pictures of a moment may have been taken at different times;
    an error along it is then put down to that. None: the board held still.
    """

    camera: int
    moment: int
    points_m: Array
    pixels: Array
    motion_px_s: Array | None = None


@dataclass(frozen=True)
class Bundle:
    """Unknowns of the adjustment; poses are a rotation vector and a translation.

    Args:
        intrinsics: (C, 10).
        cameras: (C, 6) camera-from-first; the first is zero.
        boards: (M, 6) first-camera-from-board.
    """

    intrinsics: Array
    cameras: Array
    boards: Array


@dataclass(frozen=True)
class LensPrior:
    """Prior of the lenses: (C, 10) `mean` and (C, 10, 10) `information`."""

    mean: Array
    information: Array


def matrix_of(intrinsics: Array) -> Array:
    """Return the (3, 3) camera matrix, skew included."""
    fx, fy, cx, cy, skew = intrinsics[:5]
    return np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def intrinsics_of(matrix: Array, distortion: Array) -> Array:
    """Return the (10,) intrinsics of a matrix and five distortion coefficients."""
    head = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], matrix[0, 1]]
    return np.concatenate((head, np.ravel(distortion)[:5]))


def adjust(
    start: Bundle, observations: Sequence[CornerObservation], free: Mask, prior: LensPrior | None = None
) -> Bundle:
    """Minimise the squared reprojection error by Levenberg-Marquardt.

    Args:
        free: (10,) which intrinsics of every camera are adjusted.
        prior: of the lenses, weighed against corners with `CORNER_SIGMA_PX`.
    """
    cameras = len(start.intrinsics)
    active = np.flatnonzero(np.concatenate((np.tile(free, cameras), np.repeat(np.arange(cameras) > 0, _POSE))))
    return _minimise(start, observations, active, prior)


def adjust_boards(bundle: Bundle, observations: Sequence[CornerObservation]) -> Bundle:
    """Adjust the boards' poses only, to see how well a calibration explains pictures."""
    return _minimise(bundle, observations, np.empty(0, dtype=np.int64), None)


def camera_covariance(bundle: Bundle, observations: Sequence[CornerObservation], free: Mask, prior: LensPrior) -> Array:
    """Return the covariance (6 C, 6 C) of an adjusted bundle's `cameras`.

    Inverse of the normal equations without the boards, times the residuals' own variance.
    """
    count = len(bundle.intrinsics)
    active = np.flatnonzero(np.concatenate((np.tile(free, count), np.repeat(np.arange(count) > 0, _POSE))))
    system = _normal_equations(bundle, observations, prior)
    reduced, _, scale = _reduce(system, active, 0.0)[:3]
    numbers = 2 * sum(len(observation.pixels) for observation in observations)
    variance = system.cost / max(numbers - len(active) - _POSE * len(bundle.boards), 1)
    result = np.zeros((len(system.cameras),) * 2)
    result[np.ix_(active, active)] = variance * scale * scale[:, None] * np.linalg.pinv(reduced, hermitian=True)
    return result[count * INTRINSICS :, count * INTRINSICS :]


def _minimise(
    current: Bundle, observations: Sequence[CornerObservation], active: IntArray, prior: LensPrior | None
) -> Bundle:
    damping = 1e-4
    system = _normal_equations(current, observations, prior)
    for _ in range(_ITERATIONS):
        candidate = _apply_step(current, *_step(system, active, damping))
        new = _normal_equations(candidate, observations, prior)
        if not new.cost < system.cost:
            damping *= 10.0
            if damping > _LARGEST_DAMPING:
                break
            continue
        gain = (system.cost - new.cost) / system.cost
        current, system = candidate, new
        damping = max(damping / 10.0, 1e-12)
        if gain < _SMALLEST_GAIN:
            break
    return current


def residuals(bundle: Bundle, observation: CornerObservation) -> Array:
    """Return predicted minus seen pixels (n, 2), less the part of the picture's delay."""
    errors, _ = _residuals_and_jacobian(bundle, observation)
    return _timeless(observation, errors.reshape(-1, 1)).reshape(-1, 2)


def delay_s(bundle: Bundle, observation: CornerObservation) -> float:
    """Return the delay of a picture in its moment; NaN where the board did not move."""
    if observation.motion_px_s is None or np.abs(observation.motion_px_s).max() * _TIME_SIGMA_S < CORNER_SIGMA_PX:
        return float("nan")
    errors, _ = _residuals_and_jacobian(bundle, observation)
    return float(-np.sum(errors * observation.motion_px_s) / np.sum(observation.motion_px_s**2))


def rms_by_moment(bundle: Bundle, observations: Sequence[CornerObservation]) -> Array:
    """Return the RMS reprojection error (M, C) in pixels, NaN for unseen boards."""
    table = np.full((len(bundle.boards), len(bundle.intrinsics)), np.nan)
    for observation in observations:
        errors = residuals(bundle, observation)
        table[observation.moment, observation.camera] = np.sqrt(np.mean(np.sum(errors**2, axis=1)))
    return table


def rms(bundle: Bundle, observations: Sequence[CornerObservation]) -> float:
    """Return the RMS distance in pixels over all points."""
    squares = [np.sum(residuals(bundle, observation) ** 2, axis=1) for observation in observations]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


@dataclass(frozen=True)
class _System:
    """Normal equations in blocks: cameras, boards, coupling, gradients and cost."""

    cameras: Array
    boards: Array
    coupling: Array
    cameras_gradient: Array
    boards_gradient: Array
    cost: float


def _normal_equations(bundle: Bundle, observations: Sequence[CornerObservation], prior: LensPrior | None) -> _System:
    count, moments = len(bundle.intrinsics), len(bundle.boards)
    size = count * (INTRINSICS + _POSE)
    cameras, gradient = np.zeros((size, size)), np.zeros(size)
    boards, coupling, boards_gradient = np.zeros((moments, 6, 6)), np.zeros((moments, size, 6)), np.zeros((moments, 6))
    cost = 0.0
    first = count * INTRINSICS
    columns = [
        (slice(INTRINSICS * c, INTRINSICS * (c + 1)), slice(first + _POSE * c, first + _POSE * (c + 1)))
        for c in range(count)
    ]
    for observation in observations:
        errors, jacobian = _residuals_and_jacobian(bundle, observation)
        jacobian, flat = _timeless(observation, jacobian), _timeless(observation, errors.reshape(-1, 1))[:, 0]
        lens, pose = columns[observation.camera]
        normal, down = jacobian.T @ jacobian, jacobian.T @ flat
        own = INTRINSICS + _POSE
        cameras[lens, lens] += normal[:INTRINSICS, :INTRINSICS]
        cameras[lens, pose] += normal[:INTRINSICS, INTRINSICS:own]
        cameras[pose, lens] += normal[INTRINSICS:own, :INTRINSICS]
        cameras[pose, pose] += normal[INTRINSICS:own, INTRINSICS:own]
        coupling[observation.moment, lens] += normal[:INTRINSICS, own:]
        coupling[observation.moment, pose] += normal[INTRINSICS:own, own:]
        boards[observation.moment] += normal[own:, own:]
        gradient[lens] += down[:INTRINSICS]
        gradient[pose] += down[INTRINSICS:own]
        boards_gradient[observation.moment] += down[own:]
        cost += float(flat @ flat)
    if prior is not None:
        for camera, (rows, _) in enumerate(columns):
            information = CORNER_SIGMA_PX**2 * prior.information[camera]
            off = bundle.intrinsics[camera] - prior.mean[camera]
            cameras[rows, rows] += information
            gradient[rows] += information @ off
            cost += float(off @ information @ off)
    return _System(cameras, boards, coupling, gradient, boards_gradient, cost)


def _reduce(system: _System, active: IntArray, damping: float) -> tuple[Array, Array, Array, Array, Array]:
    """Eliminate the boards (Schur complement).

    Returns the scaled matrix and right side of the active unknowns of the cameras, their scale, and the boards' step
    as far as it does not depend on the cameras (M, 6), and as it does (M, 6, N).
    """
    diagonal = np.einsum("mii->mi", system.boards)
    damped = system.boards + np.einsum("mi,ij->mij", np.where(diagonal > 0.0, damping * diagonal, 1.0), np.eye(_POSE))
    coupling = system.coupling[:, active]
    by_coupling = np.linalg.solve(damped, coupling.transpose(0, 2, 1))
    by_gradient = np.linalg.solve(damped, system.boards_gradient[..., None])[..., 0]
    full = system.cameras[np.ix_(active, active)]
    full = full + damping * np.diag(np.diag(full))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(full), 1e-30))
    reduced = full - np.einsum("mai,mib->ab", coupling, by_coupling)
    right = system.cameras_gradient[active] - np.einsum("mai,mi->a", coupling, by_gradient)
    return reduced * scale * scale[:, None], right * scale, scale, by_gradient, by_coupling


def _step(system: _System, active: IntArray, damping: float) -> tuple[Array, Array]:
    """Return the damped step of cameras (N,) and boards (M, 6)."""
    reduced, right, scale, by_gradient, by_coupling = _reduce(system, active, damping)
    step = np.zeros(len(system.cameras))
    if len(active):
        step[active] = -scale * np.linalg.lstsq(reduced, right, rcond=None)[0]
    return step, -by_gradient - np.einsum("mia,a->mi", by_coupling, step[active])


def _apply_step(bundle: Bundle, step: Array, boards: Array) -> Bundle:
    count = len(bundle.intrinsics) * INTRINSICS
    return Bundle(
        bundle.intrinsics + step[:count].reshape(-1, INTRINSICS),
        bundle.cameras + step[count:].reshape(-1, _POSE),
        bundle.boards + boards,
    )


def _timeless(observation: CornerObservation, columns: Array) -> Array:
    """Whiten columns (2n, k) of errors or derivatives along the pixels' motion.

    With corners of covariance s^2 I and a picture taken at a time unknown by t, errors have the covariance
    s^2 I + t^2 v v^T, v (2n) the pixels' motion; the result is whitened with it, in units of s.
    """
    if observation.motion_px_s is None:
        return columns
    motion = observation.motion_px_s.ravel()
    speed = float(np.linalg.norm(motion))
    if speed == 0.0:
        return columns
    along = motion / speed
    less = 1.0 - 1.0 / np.hypot(1.0, _TIME_SIGMA_S * speed / CORNER_SIGMA_PX)
    return np.asarray(columns - less * np.outer(along, along @ columns))


def _residuals_and_jacobian(bundle: Bundle, observation: CornerObservation) -> tuple[Array, Array]:
    """Return errors (n, 2) and derivatives (2n, 22) by lens, camera and board."""
    intrinsics = bundle.intrinsics[observation.camera]
    board, camera = bundle.boards[observation.moment], bundle.cameras[observation.camera]
    composed = cv2.composeRT(board[:3], board[3:], camera[:3], camera[3:])
    turn, shift = np.asarray(composed[0]), np.asarray(composed[1])
    chain = np.empty((_POSE, 2 * _POSE))  # of the board in the camera, by the camera's pose and by the board's
    chain[:3, :3], chain[:3, 3:6], chain[3:, :3], chain[3:, 3:6] = composed[4], composed[5], composed[8], composed[9]
    chain[:3, 6:9], chain[:3, 9:], chain[3:, 6:9], chain[3:, 9:] = composed[2], composed[3], composed[6], composed[7]
    fx, fy, cx, cy, skew = intrinsics[:5]
    plain = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    projected, columns = cv2.projectPoints(
        np.ascontiguousarray(observation.points_m, dtype=np.float64), turn, shift, plain, intrinsics[5:]
    )
    pixels, derivatives = np.asarray(projected, np.float64).reshape(-1, 2), np.asarray(columns, np.float64)
    height = (pixels[:, 1] - cy) / fy  # distorted y/z: what the skew acts on
    jacobian = np.empty((len(derivatives), INTRINSICS + 2 * _POSE))
    jacobian[:, :4], jacobian[:, 5:10] = derivatives[:, 6:10], derivatives[:, 10:15]
    jacobian[0::2, 4], jacobian[1::2, 4] = height, 0.0
    jacobian[0::2, 5:10] += skew / fy * derivatives[1::2, 10:15]
    by_pose = derivatives[:, :6].copy()
    by_pose[0::2] += skew / fy * derivatives[1::2, :6]
    jacobian[:, INTRINSICS:] = by_pose @ chain
    errors = pixels - observation.pixels
    errors[:, 0] += skew * height
    return errors, jacobian
