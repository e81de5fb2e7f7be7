"""Interacting multiple model filter (Blom and Bar-Shalom 1988) for points that rest, move and strike.

The models are constant-acceleration Kalman filters that differ in how fast the acceleration may change. The better a
model predicts a point, the more weight it has, so a point at rest is held still and a fast one does not lag.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..kernel.library import address, checked, contiguous, function, stage
from .arrays import Array, Mask

_POWERS, _DIVISORS = np.array([[5, 4, 3], [4, 3, 2], [3, 2, 1]]), np.array([[20, 8, 6], [8, 3, 2], [6, 2, 1]])
_EXPONENTS = np.arange(6)


def _movements() -> tuple[Array, Array]:
    """Return the matrices for prediction as polynomials in time, one row per power.

    Returns:
        The transition (6, 18 * 18) for rows of state and covariance, and the covariance (6, 9) that is added per unit
        of the jerk's spectral density.
    """
    # transition of position, velocity and acceleration, by powers of time
    move = np.array([np.eye(3), np.eye(3, k=1), 0.5 * np.eye(3, k=2)])
    rows, jerks = np.zeros((6, 18, 18)), np.zeros((6, 9))
    for power, matrix in enumerate(move):
        rows[power, :9, :9] = np.kron(matrix, np.eye(3)).T
        for other, factor in enumerate(move):
            rows[power + other, 9:, 9:] += np.kron(matrix, factor).T
    for place, (power, divisor) in enumerate(zip(_POWERS.ravel(), _DIVISORS.ravel(), strict=True)):
        jerks[power, place] = 1.0 / divisor
    return rows.reshape(6, -1), jerks


_MOVEMENT, _JERKS = _movements()


@dataclass(frozen=True)
class MotionModels:
    """Parameters of how points move; lengths are in the points' unit."""

    changes: tuple[float, ...]  # third difference at 60 Hz that each model expects
    least_sigma: float  # smallest standard deviation of a measured coordinate
    jump: float  # distance from the prediction of every model beyond which a point is re-initialised
    first_speed: float  # standard deviation of the initial velocity, per s
    first_acceleration: float  # standard deviation of the initial acceleration, per s^2
    holds_s: float = 1.0  # mean time after which a point changes to another model
    pause_s: float = 0.25  # time without measurement after which a point is re-initialised
    jump_sigmas: float = 8.0  # the same distance in standard deviations, which must also be exceeded

    @cached_property
    def densities(self) -> Array:
        """Spectral densities (K,) of the jerk, which is white noise, unit^2 / s^5."""
        return np.square(self.changes) * 60.0**5


class MultipleModelFilter:
    """Filter for N points in space, frame by frame."""

    def __init__(self, kind: MotionModels, points: int) -> None:
        self._kind = kind
        self._seen_s = np.full(points, -np.inf)
        self._time_s = 0.0
        models = len(kind.changes)
        self._hold(np.full((points, models), 1.0 / models), np.zeros((points, models, 18)))

    def _hold(self, weights: Array, rows: Array) -> None:
        """Store the models' weights (N, K) and rows (N, K, 9 + 9): see `_parts`."""
        self._weights, self._rows = weights, rows
        self._states, self._covariances = _parts(rows)

    def __setstate__(self, values: dict[str, Any]) -> None:
        """Restore a copy, in which states and covariances are views of the same rows again."""
        self.__dict__.update(values)
        self._hold(self._weights, self._rows)

    @property
    def followed(self) -> Mask:
        """Mask (N,) of the points that were measured recently."""
        return np.asarray(self._time_s - self._seen_s < self._kind.pause_s)

    def forget(self, points: Mask) -> None:
        """Forget the points in a mask (N,), so that their next measurements initialise them."""
        self._seen_s[points] = -np.inf

    def predict(self, time_s: float) -> None:
        """Predict the points at a later time."""
        elapsed_s = min(max(time_s - self._time_s, 0.0), self._kind.pause_s)
        self._hold(*predicted(self._weights, self._rows, elapsed_s, self._kind))
        self._time_s = time_s

    def observe(self, points: Array, noise: Array) -> Mask:
        """Correct the prediction with measurements.

        Args:
            points: Measured points (N, 3), NaN where there is none.
            noise: Standard deviations (N,) of their coordinates.

        Returns:
            Mask (N,) of the points that were not re-initialised.
        """
        sigmas = np.maximum(noise, self._kind.least_sigma)
        weights, rows, known = corrected(self._weights, self._rows, self.followed, points, sigmas, self._kind)
        self._hold(weights, rows)
        self._seen_s[np.isfinite(points[:, 0])] = self._time_s
        return known

    def log_likelihoods(self, points: Array, noise: Array) -> Array:
        """Return the log densities (N,) of measurements, per unit of volume; NaN for points without a measurement."""
        sigmas = np.maximum(noise, self._kind.least_sigma)
        _, variances, _, unlikely = _innovations(self._states, self._covariances, points, sigmas)
        logs = np.log(np.maximum(self._weights, 1e-300)) - 1.5 * np.log(2.0 * np.pi * variances) - 0.5 * unlikely
        most = np.maximum.reduce(logs, axis=1)
        found = most + np.log(np.add.reduce(np.exp(logs - most[:, None]), axis=1))
        return np.where(np.isfinite(points[:, 0]), found, np.nan)

    def means(self) -> tuple[Array, Array]:
        """Return the estimated positions (N, 3), and the standard deviations (N,) of their coordinates."""
        positions = self._states[:, :, 0]
        means = (self._weights[:, None] @ positions)[:, 0]
        spread = np.add.reduce((positions - means[:, None]) ** 2, axis=-1) / 3.0
        variances = np.add.reduce(self._weights * (self._covariances[..., 0, 0] + spread), axis=1)
        return means, np.sqrt(np.maximum(variances, 1e-12))

    def speeds(self) -> Array:
        """Return the estimated speeds (N,), units per s."""
        return np.asarray(np.linalg.norm((self._weights[:, None] @ self._states[:, :, 1])[:, 0], axis=1))


_PREDICT = function("predict_points", "nnddppppp")
_CORRECT = function("correct_points", "nnppppppp")


def _compiled_prediction(weights: Array, rows: Array, elapsed_s: float, kind: MotionModels) -> tuple[Array, Array]:
    next_weights, next_rows = np.empty(weights.shape), np.empty(rows.shape)
    given = contiguous(kind.densities), contiguous(weights), contiguous(rows)
    stays = math.exp(-elapsed_s / kind.holds_s)
    checked(_PREDICT(*weights.shape, elapsed_s, stays, *given, address(next_weights), address(next_rows)))
    return next_weights, next_rows


@stage(_compiled_prediction)
def predicted(weights: Array, rows: Array, elapsed_s: float, kind: MotionModels) -> tuple[Array, Array]:
    """Return weights (N, K) and rows (N, K, 18) predicted with each model, starting from a mixture of all models."""
    models = weights.shape[1]
    stays = math.exp(-elapsed_s / kind.holds_s)
    changes = np.full((models, models), (1.0 - stays) / (models - 1))
    changes.flat[:: models + 1] = stays
    shares = weights[:, :, None] * changes
    weights = np.add.reduce(shares, axis=1)
    shares /= np.maximum(weights, 1e-300)[:, None]
    # The covariance of a mixture is the mean of the covariances plus the covariance of the means, averaged over the
    # axes. Means are taken relative to the first model's, which preserves precision for points far from the origin.
    rows = rows.copy()
    states, covariances = _parts(rows)
    first = states[:, :1].copy()
    apart = states - first
    covariances += apart @ apart.swapaxes(-1, -2) / 3.0
    mixed = shares.swapaxes(1, 2) @ rows
    apart = mixed[..., :9].reshape(apart.shape) - first
    mixed[..., 9:] -= (apart @ apart.swapaxes(-1, -2) / 3.0).reshape(*mixed.shape[:2], 9)
    powers = elapsed_s**_EXPONENTS
    moved = mixed @ (powers @ _MOVEMENT).reshape(18, 18)
    moved[..., 9:] += kind.densities[..., None] * (powers @ _JERKS)
    return weights, moved


def _compiled_correction(
    weights: Array, rows: Array, followed: Mask, points: Array, sigmas: Array, kind: MotionModels
) -> tuple[Array, Array, Mask]:
    weights, rows, known = weights.copy(), rows.copy(), followed.copy()
    limits = (kind.jump**2, kind.jump_sigmas**2, kind.first_speed**2, kind.first_acceleration**2)
    given = contiguous(points), contiguous(sigmas), contiguous(limits)
    changed = address(weights), address(rows), address(known), address(np.empty(3 * weights.shape[1]))
    checked(_CORRECT(*weights.shape, *given, *changed))
    return weights, rows, known


@stage(_compiled_correction)
def corrected(
    weights: Array, rows: Array, followed: Mask, points: Array, sigmas: Array, kind: MotionModels
) -> tuple[Array, Array, Mask]:
    """Return weights (N, K) and rows (N, K, 18) corrected with measurements; see `MultipleModelFilter.observe`.

    Args:
        followed: Mask (N,) of the points that were measured recently; others begin anew.
        sigmas: Standard deviations (N,) of the measured coordinates.

    Returns:
        Weights, rows, and a mask (N,) of the points that were not re-initialised.
    """
    weights, rows = weights.copy(), rows.copy()
    states, covariances = _parts(rows)
    innovations, variances, squares, unlikely = _innovations(states, covariances, points, sigmas)
    located = np.isfinite(points[:, 0])
    far = np.logical_and.reduce((squares > kind.jump**2) & (unlikely > kind.jump_sigmas**2), axis=1)
    known = followed & located & ~far
    seen: Mask | slice = slice(None) if known.all() else known  # slices are faster than masks
    own, spread = covariances[seen], variances[seen]
    gains = (own[..., 0] / spread[..., None])[..., None]
    states[seen] += gains * innovations[seen][:, :, None]
    covariances[seen] -= gains * own[:, :, :1]
    likely = np.maximum(weights[seen], 1e-300) / (spread * np.sqrt(spread))
    logs = np.log(likely) - 0.5 * unlikely[seen]
    kept = np.exp(logs - np.maximum.reduce(logs, axis=1, keepdims=True))
    weights[seen] = kept / np.add.reduce(kept, axis=1, keepdims=True)
    if (new := located & ~known).any():  # they begin at their measurements
        states[new], covariances[new], weights[new] = 0.0, 0.0, 1.0 / weights.shape[1]
        states[new, :, 0] = points[new, None]
        covariances[new, :, 0, 0] = np.square(sigmas[new])[:, None]
        covariances[new, :, 1, 1], covariances[new, :, 2, 2] = kind.first_speed**2, kind.first_acceleration**2
    return weights, rows, known


def _parts(rows: Array) -> tuple[Array, Array]:
    """Return views (N, K, 3, 3) of rows: position, velocity and acceleration by axis, and their shared covariance."""
    states, covariances = (part.reshape(*rows.shape[:2], 3, 3) for part in (rows[..., :9], rows[..., 9:]))
    return states, covariances


def _innovations(states: Array, covariances: Array, points: Array, sigmas: Array) -> tuple[Array, Array, Array, Array]:
    """Return innovations (N, K, 3), and their variances, squared lengths and squares over variances (N, K each)."""
    located = np.isfinite(points[:, :1])
    innovations = np.where(located, points, 0.0)[:, None] - states[:, :, 0]
    variances = covariances[..., 0, 0] + (sigmas * sigmas)[:, None]
    squares = np.add.reduce(innovations * innovations, axis=-1)
    return innovations, variances, squares, squares / variances
