"""Bundle adjustment of cameras and board poses (Triggs et al., 2000).

Unlike OpenCV's stereo calibration, it handles skew of the pixel grid, any number of cameras, a prior for the lenses,
and cameras that take the pictures of a moment at slightly different times.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...geometry.arrays import Array, IntArray, Mask
from ...geometry.least_squares import NormalEquations, levenberg_marquardt

INTRINSICS = 10
"""fx, fy, cx, cy, skew, k1, k2, p1, p2, k3 of one camera, in this order."""

_POSE = 6


@dataclass(frozen=True)
class FitSettings:
    """Settings for fitting boards, lenses and cameras together."""

    corner_sigma_px: float = 0.2  # standard deviation of a corner along each axis, as observed in recordings
    time_sigma_s: float = 0.05  # standard deviation of a picture's time: unsynchronised cameras are a frame or more off
    aspect_sigma: float = 0.01  # prior standard deviation of fx - fy, as a share of the image's width
    # prior standard deviations of cx, cy, skew (shares of the width), k1, k2, p1, p2, k3 for ordinary lenses
    lens_sigmas: tuple[float, ...] = (0.15, 0.15, 0.03, 0.5, 1.0, 0.02, 0.02, 3.0)
    # Largest differences between the poses of one board as two cameras see it. The limits are wide, because board poses
    # from one camera are rough; half turns and wrong pairs are far outside them.
    same_angle_deg: float = 8.0
    same_distance: float = 0.3  # share of the median distance to the board
    outlier_factor: float = 3.0  # smallest error of an outlier, as a multiple of the median error
    outlier_floor_px: float = 0.6  # smallest difference of an outlier's error from the median
    folds: int = 5  # number of parts into which the moments are divided; each part is held out in turn
    least_moments: int = 10  # fewest moments for which lens models are compared by held-out errors
    richer_may_cost: float = 1.05  # largest held-out error of the chosen lens model, as a multiple of the best model's


FIT = FitSettings()


@dataclass(frozen=True)
class CornerObservation:
    """Board points (n, 3) seen as pixels (n, 2) by one camera at one moment.

    Args:
        motion_px_s: Velocities (n, 2) of the points in the image; errors along them may come from the picture's delay.
            None if the board was still.
    """

    camera: int
    moment: int
    points_m: Array
    pixels: Array
    motion_px_s: Array | None = None


@dataclass(frozen=True)
class Bundle:
    """Unknowns of the adjustment; a pose is a rotation vector and a translation."""

    intrinsics: Array  # (C, 10) fx, fy, cx, cy, skew, k1, k2, p1, p2, k3
    cameras: Array  # (C, 6) camera-from-first; the first is zero
    boards: Array  # (M, 6) first-camera-from-board


@dataclass(frozen=True)
class LensPrior:
    """Mean (C, 10) and inverse covariance (C, 10, 10) of the lenses."""

    mean: Array
    information: Array


def matrix_of(intrinsics: Array) -> Array:
    """Return the camera matrix (3, 3), including skew."""
    fx, fy, cx, cy, skew = intrinsics[:5]
    return np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def intrinsics_of(matrix: Array, distortion: Array) -> Array:
    """Return the intrinsics (10,) for a matrix and five distortion coefficients."""
    head = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], matrix[0, 1]]
    return np.concatenate((head, np.ravel(distortion)[:5]))


def adjust(
    start: Bundle, observations: Sequence[CornerObservation], free: Mask, prior: LensPrior | None = None
) -> Bundle:
    """Minimise the squared reprojection error by Levenberg-Marquardt.

    Args:
        free: Mask (10,) of the intrinsics that are adjusted, the same for all cameras.
    """
    return _minimise(start, observations, _unknowns(start, free), prior)


def adjust_boards(bundle: Bundle, observations: Sequence[CornerObservation]) -> Bundle:
    """Adjust only the poses of the boards, to test a calibration on other pictures."""
    first = bundle.intrinsics.size + bundle.cameras.size
    return _minimise(bundle, observations, np.arange(first, first + bundle.boards.size), None)


def camera_covariance(bundle: Bundle, observations: Sequence[CornerObservation], free: Mask, prior: LensPrior) -> Array:
    """Return the covariance (6 C, 6 C) of an adjusted bundle's `cameras`, scaled by the variance of its residuals."""
    unknowns = _unknowns(bundle, free)
    near = _linearise(bundle, observations, prior)
    part = near.matrix[np.ix_(unknowns, unknowns)]
    scale = 1.0 / np.sqrt(np.maximum(part.diagonal(), 1e-30))
    inverse = scale * scale[:, None] * np.linalg.pinv(part * scale * scale[:, None], hermitian=True)
    numbers = 2 * sum(len(observation.pixels) for observation in observations)
    result = np.zeros_like(near.matrix)
    result[np.ix_(unknowns, unknowns)] = near.cost / max(numbers - len(unknowns), 1) * inverse
    first = bundle.intrinsics.size
    return result[first : first + bundle.cameras.size, first : first + bundle.cameras.size]


def _unknowns(bundle: Bundle, free: Mask) -> IntArray:
    """Return the indices of a bundle's adjusted parameters: free intrinsics, cameras except the first, boards."""
    count = len(bundle.intrinsics)
    others = np.arange(bundle.cameras.size + bundle.boards.size) >= _POSE
    return np.flatnonzero(np.concatenate((np.tile(free, count), others)))


def _minimise(
    start: Bundle, observations: Sequence[CornerObservation], unknowns: IntArray, prior: LensPrior | None
) -> Bundle:
    def linearise(bundle: Bundle) -> NormalEquations:
        near = _linearise(bundle, observations, prior)
        return NormalEquations(near.matrix[np.ix_(unknowns, unknowns)], near.gradient[unknowns], near.cost)

    def move(bundle: Bundle, step: Array) -> Bundle:
        parts = (bundle.intrinsics, bundle.cameras, bundle.boards)
        flat = np.concatenate([part.ravel() for part in parts])
        flat[unknowns] += step
        moved = np.split(flat, np.cumsum([part.size for part in parts[:2]]))
        return Bundle(*(values.reshape(part.shape) for values, part in zip(moved, parts, strict=True)))

    return levenberg_marquardt(start, linearise, move)[0]


def _linearise(bundle: Bundle, observations: Sequence[CornerObservation], prior: LensPrior | None) -> NormalEquations:
    """Return the normal equations of all parameters of a bundle, in the order of its fields."""
    first = bundle.intrinsics.size
    size = first + bundle.cameras.size + bundle.boards.size
    matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
    lenses = np.arange(first).reshape(bundle.intrinsics.shape)
    cameras, boards = np.split(np.arange(first, size).reshape(-1, _POSE), [len(bundle.cameras)])
    for seen in observations:
        errors, jacobian = _residuals_and_jacobian(bundle, seen)
        jacobian, flat = _without_delay(seen, jacobian), _without_delay(seen, errors.reshape(-1, 1))[:, 0]
        own = np.concatenate((lenses[seen.camera], cameras[seen.camera], boards[seen.moment]))
        matrix[np.ix_(own, own)] += jacobian.T @ jacobian
        gradient[own] += jacobian.T @ flat
        cost += float(flat @ flat)
    if prior is not None:
        for camera, rows in enumerate(lenses):
            information = FIT.corner_sigma_px**2 * prior.information[camera]
            off = bundle.intrinsics[camera] - prior.mean[camera]
            matrix[np.ix_(rows, rows)] += information
            gradient[rows] += information @ off
            cost += float(off @ information @ off)
    return NormalEquations(matrix, gradient, cost)


def residuals(bundle: Bundle, observation: CornerObservation) -> Array:
    """Return predicted minus observed pixels (n, 2), without the part explained by the picture's delay."""
    errors, _ = _residuals_and_jacobian(bundle, observation)
    return _without_delay(observation, errors.reshape(-1, 1)).reshape(-1, 2)


def delay_s(bundle: Bundle, observation: CornerObservation) -> float:
    """Return the delay of a picture relative to its moment; NaN if the board did not move."""
    motion = observation.motion_px_s
    if motion is None or np.abs(motion).max() * FIT.time_sigma_s < FIT.corner_sigma_px:
        return float("nan")
    errors, _ = _residuals_and_jacobian(bundle, observation)
    return float(-np.sum(errors * motion) / np.sum(motion**2))


def rms_by_moment(bundle: Bundle, observations: Sequence[CornerObservation]) -> Array:
    """Return the RMS reprojection error (M, C) in pixels, NaN for boards not seen."""
    table = np.full((len(bundle.boards), len(bundle.intrinsics)), np.nan)
    for observation in observations:
        table[observation.moment, observation.camera] = rms(bundle, [observation])
    return table


def rms(bundle: Bundle, observations: Sequence[CornerObservation]) -> float:
    """Return the RMS reprojection error in pixels over all points."""
    squares = [np.sum(residuals(bundle, observation) ** 2, axis=1) for observation in observations]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _without_delay(observation: CornerObservation, columns: Array) -> Array:
    """Whiten columns (2n, k) of errors or derivatives along the pixels' motion.

    Corners have the covariance s^2 I and a picture's time the variance t^2, so errors have the covariance
    s^2 I + t^2 v v^T with the pixels' velocities v (2n); the result is whitened with it, in units of s.
    """
    motion = np.zeros(1) if observation.motion_px_s is None else observation.motion_px_s.ravel()
    speed = float(np.linalg.norm(motion))
    if speed == 0.0:
        return columns
    along = motion / speed
    less = 1.0 - 1.0 / np.hypot(1.0, FIT.time_sigma_s * speed / FIT.corner_sigma_px)
    return np.asarray(columns - less * np.outer(along, along @ columns))


def _residuals_and_jacobian(bundle: Bundle, observation: CornerObservation) -> tuple[Array, Array]:
    """Return errors (n, 2) and derivatives (2n, 22) with respect to lens, camera and board."""
    intrinsics = bundle.intrinsics[observation.camera]
    board, camera = bundle.boards[observation.moment], bundle.cameras[observation.camera]
    composed = cv2.composeRT(board[:3], board[3:], camera[:3], camera[3:])
    turn, shift = np.asarray(composed[0]), np.asarray(composed[1])
    chain = np.empty((_POSE, 2 * _POSE))  # derivatives of the composed pose with respect to both poses
    chain[:3, :3], chain[:3, 3:6], chain[3:, :3], chain[3:, 3:6] = composed[4], composed[5], composed[8], composed[9]
    chain[:3, 6:9], chain[:3, 9:], chain[3:, 6:9], chain[3:, 9:] = composed[2], composed[3], composed[6], composed[7]
    fx, fy, cx, cy, skew = intrinsics[:5]
    plain = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    projected, columns = cv2.projectPoints(
        np.ascontiguousarray(observation.points_m, dtype=np.float64), turn, shift, plain, intrinsics[5:]
    )
    pixels, derivatives = np.asarray(projected, np.float64).reshape(-1, 2), np.asarray(columns, np.float64)
    height = (pixels[:, 1] - cy) / fy  # distorted y/z, which is multiplied by the skew
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
