"""Interacting multiple model filter (Blom and Bar-Shalom 1988) for points that rest, move and strike.

The models are constant-acceleration Kalman filters that differ in how fast the acceleration may change. The better a
model predicts a point, the more weight it has, so a point at rest is held still and a fast one does not lag.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

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


class MultipleModelFilter:
    """Filter for N points in space, frame by frame."""

    def __init__(self, kind: MotionModels, points: int) -> None:
        self._kind = kind
        self._densities = (
            np.square(kind.changes) * 60.0**5
        )  # spectral densities (K,) of the jerk, which is white noise, unit^2 / s^5
        self._seen_s = np.full(points, -np.inf)
        self._time_s = 0.0
        models = len(self._densities)
        self._weights = np.full((points, models), 1.0 / models)
        self._hold(np.zeros((points, models, 18)))

    def _hold(self, rows: Array) -> None:
        """Store the state (N, K, 9 + 9): position, velocity and acceleration by axis, and their shared covariance."""
        self._states, self._covariances = (
            part.reshape(*rows.shape[:2], 3, 3) for part in (rows[..., :9], rows[..., 9:])
        )
        self._rows = rows

    def __setstate__(self, values: dict[str, Any]) -> None:
        """Restore a copy, in which states and covariances are views of the same rows again."""
        self.__dict__.update(values)
        self._hold(self._rows)

    @property
    def followed(self) -> Mask:
        """Mask (N,) of the points that were measured recently."""
        return np.asarray(self._time_s - self._seen_s < self._kind.pause_s)

    def forget(self, points: Mask) -> None:
        """Forget the points in a mask (N,), so that their next measurements initialise them."""
        self._seen_s[points] = -np.inf

    def predict(self, time_s: float) -> None:
        """Predict the points at a later time."""
        self._move(min(max(time_s - self._time_s, 0.0), self._kind.pause_s))
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
        located = np.isfinite(points[:, 0])
        innovations, variances, squares, unlikely = self._innovations(points, sigmas)
        known = self.followed & located & ~self._far(squares, unlikely)
        # slices are faster than masks
        self._update(slice(None) if known.all() else known, innovations, variances, unlikely)
        if (new := located & ~known).any():
            self._start(new, points, sigmas)
        self._seen_s[located] = self._time_s
        return known

    def log_likelihoods(self, points: Array, noise: Array) -> Array:
        """Return the log densities (N,) of measurements, per unit of volume; NaN for points without a measurement."""
        _, variances, _, unlikely = self._innovations(points, np.maximum(noise, self._kind.least_sigma))
        logs = np.log(np.maximum(self._weights, 1e-300)) - 1.5 * np.log(2.0 * np.pi * variances) - 0.5 * unlikely
        most = np.maximum.reduce(logs, axis=1)
        found = most + np.log(np.add.reduce(np.exp(logs - most[:, None]), axis=1))
        return np.where(np.isfinite(points[:, 0]), found, np.nan)

    def _innovations(self, points: Array, sigmas: Array) -> tuple[Array, Array, Array, Array]:
        """Return innovations (N, K, 3), and their variances, squared lengths and squares over variances (N, K each)."""
        located = np.isfinite(points[:, :1])
        innovations = np.where(located, points, 0.0)[:, None] - self._states[:, :, 0]
        variances = self._covariances[..., 0, 0] + (sigmas * sigmas)[:, None]
        squares = np.add.reduce(innovations * innovations, axis=-1)
        return innovations, variances, squares, squares / variances

    def _far(self, squares: Array, unlikely: Array) -> Mask:
        far = (squares > self._kind.jump**2) & (unlikely > self._kind.jump_sigmas**2)
        return np.asarray(np.logical_and.reduce(far, axis=1))

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

    def _move(self, elapsed_s: float) -> None:
        """Predict with each model, starting from a mixture of all models."""
        models = self._weights.shape[1]
        stays = math.exp(-elapsed_s / self._kind.holds_s)
        changes = np.full((models, models), (1.0 - stays) / (models - 1))
        changes.flat[:: models + 1] = stays
        shares = self._weights[:, :, None] * changes
        self._weights = np.add.reduce(shares, axis=1)
        shares /= np.maximum(self._weights, 1e-300)[:, None]
        # The covariance of a mixture is the mean of the covariances plus the covariance of the means, averaged over the
        # axes. Means are taken relative to the first model's, which preserves precision for points far from the origin.
        first = self._states[:, :1]
        apart = self._states - first
        self._covariances += apart @ apart.swapaxes(-1, -2) / 3.0
        mixed = shares.swapaxes(1, 2) @ self._rows
        apart = mixed[..., :9].reshape(apart.shape) - first
        mixed[..., 9:] -= (apart @ apart.swapaxes(-1, -2) / 3.0).reshape(*mixed.shape[:2], 9)
        powers = elapsed_s**_EXPONENTS
        moved = mixed @ (powers @ _MOVEMENT).reshape(18, 18)
        moved[..., 9:] += self._densities[..., None] * (powers @ _JERKS)
        self._hold(moved)

    def _update(self, seen: Mask | slice, innovations: Array, variances: Array, unlikely: Array) -> None:
        """Correct the models, and their weights, for the points that were measured."""
        covariances, variances = self._covariances[seen], variances[seen]
        gains = (covariances[..., 0] / variances[..., None])[..., None]
        self._states[seen] += gains * innovations[seen][:, :, None]
        self._covariances[seen] -= gains * covariances[:, :, :1]
        likely = np.maximum(self._weights[seen], 1e-300) / (variances * np.sqrt(variances))
        logs = np.log(likely) - 0.5 * unlikely[seen]
        weights = np.exp(logs - np.maximum.reduce(logs, axis=1, keepdims=True))
        self._weights[seen] = weights / np.add.reduce(weights, axis=1, keepdims=True)

    def _start(self, new: Mask, points: Array, sigmas: Array) -> None:
        """Initialise points at their measurements."""
        self._states[new] = 0.0
        self._states[new, :, 0] = points[new, None]
        self._covariances[new] = 0.0
        self._covariances[new, :, 0, 0] = np.square(sigmas[new])[:, None]
        self._covariances[new, :, 1, 1] = self._kind.first_speed**2
        self._covariances[new, :, 2, 2] = self._kind.first_acceleration**2
        self._weights[new] = 1.0 / self._weights.shape[1]
