"""Kalman filters of several models for points that stand, move and strike.

Each point is followed by filters with constant acceleration that differ in how suddenly it may change. How well each
predicts decides how much it counts (interacting multiple models, Blom and Bar-Shalom 1988). So a still point is held
still and a fast one is not late.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Array, Mask

_POWERS, _DIVISORS = np.array([[5, 4, 3], [4, 3, 2], [3, 2, 1]]), np.array([[20, 8, 6], [8, 3, 2], [6, 2, 1]])
_STAYS_S = 1.0  # mean time for which one of the models holds
_PAUSE_S = 0.25  # after so long out of sight a point starts over,
_JUMP_SIGMAS = 8.0  # and where it is so far from every prediction


@dataclass(frozen=True)
class MotionModels:
    """How points of one kind move, in their unit.

    Args:
        changes: (K,) third differences at 60 Hz of each model.
        least_sigma: deviation of a coordinate of points without noise.
        jump: distance from every prediction, beyond which a point starts over.
        first_speed, first_acceleration: their deviations at a start, per s and s^2.
    """

    changes: tuple[float, ...]
    least_sigma: float
    jump: float
    first_speed: float
    first_acceleration: float


class MultipleModelFilter:
    """Follows points in space.

    Args:
        points: number of points of each kind; all kinds have as many models.
    """

    def __init__(self, *kinds: tuple[MotionModels, int]) -> None:
        repeats = [count for _, count in kinds]

        def of_points(values: list[Any]) -> Array:
            return np.repeat(np.array(values), repeats, axis=0)

        # of the jerk's white noise, unit^2 / s^5
        self._densities = np.square(of_points([kind.changes for kind, _ in kinds])) * 60.0**5
        self._least = of_points([kind.least_sigma for kind, _ in kinds])
        self._jump = of_points([kind.jump for kind, _ in kinds])
        self._first = np.square(of_points([(kind.first_speed, kind.first_acceleration) for kind, _ in kinds]))
        points, models = self._densities.shape
        self._seen_s = np.full(points, -np.inf)
        self._time_s = 0.0
        # (N, K, 3, 3) position, velocity, acceleration by axis; (N, K, 3, 3) their covariance, the same for each axis
        self._states, self._covariances = np.zeros((2, points, models, 3, 3))
        self._weights = np.full((points, models), 1.0 / models)

    def predict(self, time_s: float) -> None:
        """Move to a later time."""
        self._move(float(np.clip(time_s - self._time_s, 0.0, _PAUSE_S)))
        self._time_s = time_s

    def observe(self, points: Array, noise: Array) -> Mask:
        """Correct the prediction by points (N, 3), NaN where unseen, of known noise (N,).

        Returns:
            Points (N,) that go on from where they were.
        """
        sigmas = np.maximum(noise, self._least)
        located = np.isfinite(points[:, 0])
        innovations = np.where(located[:, None], points, 0.0)[:, None] - self._states[:, :, 0]
        variances = self._covariances[..., 0, 0] + np.square(sigmas)[:, None]
        unlikely = np.sum(innovations**2, axis=-1) / variances
        far = np.linalg.norm(innovations, axis=-1) > self._jump[:, None]
        jumped = np.all(far & (unlikely > _JUMP_SIGMAS**2), axis=1)
        known = (self._time_s - self._seen_s < _PAUSE_S) & ~jumped
        self._update(located & known, innovations, variances, unlikely)
        self._start(located & ~known, points, sigmas)
        self._seen_s[located] = self._time_s
        return np.asarray(located & known)

    def means(self) -> tuple[Array, Array]:
        """Return positions (N, 3) and the deviations (N,) of their coordinates."""
        positions = self._states[:, :, 0]
        means = (self._weights[:, None] @ positions)[:, 0]
        spread = np.add.reduce((positions - means[:, None]) ** 2, axis=-1) / 3.0
        variances = np.add.reduce(self._weights * (self._covariances[..., 0, 0] + spread), axis=1)
        return means, np.sqrt(np.maximum(variances, 1e-12))

    def _move(self, elapsed_s: float) -> None:
        """Move all models on; each starts from a mixture of all."""
        models = self._weights.shape[1]
        stays = np.exp(-elapsed_s / _STAYS_S)
        changes = np.full((models, models), (1.0 - stays) / (models - 1))
        np.fill_diagonal(changes, stays)
        shares = self._weights[:, :, None] * changes
        self._weights = shares.sum(axis=1)
        shares /= np.maximum(self._weights, 1e-300)[:, None]
        # of a mixture: means, and the mean covariance plus that of the means (of all three axes alike)
        flat, shape = (len(shares), models, -1), self._states.shape
        together = self._covariances + self._states @ self._states.swapaxes(-1, -2) / 3.0
        columns = np.concatenate((self._states.reshape(flat), together.reshape(flat)), axis=2)
        mixed, covariances = (
            (shares.swapaxes(1, 2) @ columns).reshape(*shape[:2], 2, 3, 3).swapaxes(0, 2).swapaxes(1, 2)
        )
        covariances = covariances - mixed @ mixed.swapaxes(-1, -2) / 3.0
        moved = np.array([[1.0, elapsed_s, elapsed_s**2 / 2.0], [0.0, 1.0, elapsed_s], [0.0, 0.0, 1.0]])
        self._states = moved @ mixed
        self._covariances = moved @ covariances @ moved.T
        self._covariances += self._densities[..., None, None] * (elapsed_s**_POWERS / _DIVISORS)

    def _update(self, seen: Mask, innovations: Array, variances: Array, unlikely: Array) -> None:
        """Correct the models of the seen points, and how much each counts."""
        gains = self._covariances[seen, :, :, 0] / variances[seen, :, None]
        self._states[seen] += gains[..., None] * innovations[seen][:, :, None]
        self._covariances[seen] -= gains[..., None] * self._covariances[seen, :, :1]
        logs = np.log(np.maximum(self._weights[seen], 1e-300)) - 0.5 * unlikely[seen] - 1.5 * np.log(variances[seen])
        weights = np.exp(logs - logs.max(axis=1, keepdims=True))
        self._weights[seen] = weights / weights.sum(axis=1, keepdims=True)

    def _start(self, new: Mask, points: Array, sigmas: Array) -> None:
        """Follow points from where they are."""
        self._states[new] = 0.0
        self._states[new, :, 0] = points[new, None]
        self._covariances[new] = 0.0
        self._covariances[new, :, 0, 0] = np.square(sigmas[new])[:, None]
        self._covariances[new, :, 1, 1] = self._first[new, :1]
        self._covariances[new, :, 2, 2] = self._first[new, 1:]
        self._weights[new] = 1.0 / self._weights.shape[1]
