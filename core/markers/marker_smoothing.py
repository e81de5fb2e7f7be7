"""Smoothing of markers by their own noise, without delay.

Each marker is followed by Kalman filters with constant acceleration that differ in how suddenly it may change: a body
that stands, one that moves, one that strikes. How well each predicts decides how much it counts (interacting multiple
models, Blom and Bar-Shalom 1988). So a still marker is held still and a fast one is not late. Exact markers pass as
they are.
"""

import numpy as np

from ..geometry.arrays import Array, Mask
from .marker_noise import MarkerNoise, marker_noise

_CHANGES_M = (0.01e-3, 0.1e-3, 1e-3)  # third differences at 60 Hz of markers that stand, move, strike
_DENSITIES = np.square(_CHANGES_M) * 60.0**5  # of the jerk's white noise, m^2/s^5
_POWERS, _DIVISORS = np.array([[5, 4, 3], [4, 3, 2], [3, 2, 1]]), np.array([[20, 8, 6], [8, 3, 2], [6, 2, 1]])
_STAYS_S = 1.0  # mean time for which one of these holds
_LEAST_SIGMA_M = 0.2e-3  # of markers without noise: skin and optics
_UNKNOWN_SIGMA_M = 1e-3  # in the first frames
_MOST_SIGMA_M = 4e-3  # beyond that it is sudden motion at a low rate
_PAUSE_S = 0.25  # after so long out of sight a marker starts over,
_JUMP_SIGMAS, _JUMP_M = 8.0, 0.05  # and where it is so far from every prediction
_FIRST_SPEED_M_S, _FIRST_ACCELERATION_M_S2 = 2.0, 20.0  # deviations at a start


class MarkerSmoother:
    """Smooths the markers of one body, frame by frame.

    Args:
        markers: their number M.
    """

    def __init__(self, markers: int) -> None:
        self._noise = MarkerNoise()
        self._follower = _Follower(markers)

    def step(self, time_s: float, points_m: Array) -> tuple[Array, Array]:
        """Return smoothed markers (M, 3) and deviations (M,) of a coordinate, metres.

        Args:
            time_s: ascending.
            points_m: (M, 3), NaN where a marker was not located; stays so.
        """
        self._follower.predict(time_s)
        noise_m = np.minimum(self._noise.step(time_s, points_m), _MOST_SIGMA_M)
        self._follower.observe(points_m, np.where(noise_m > 0.0, noise_m, _UNKNOWN_SIGMA_M))
        means, deviations = self._follower.means()
        return np.where(np.isfinite(points_m), means, np.nan), deviations


def smooth_markers(times_s: Array, points_m: Array) -> tuple[Array, Array]:
    """Return a take's markers (F, M, 3) smoothed, and their deviations (F, M).

    By earlier and later ones: two filters, one of them backwards (Fraser and Potter 1969).

    Args:
        times_s: (F,) ascending.
        points_m: metres, NaN where a marker was not located; stays so.
    """
    noise_m = np.minimum(marker_noise(times_s, points_m), _MOST_SIGMA_M)
    smoothed, deviations = np.full(points_m.shape, np.nan), np.zeros(points_m.shape[:2])
    forwards, backwards = _Follower(points_m.shape[1]), _Follower(points_m.shape[1])
    for index, time_s in enumerate(times_s):
        forwards.predict(time_s)
        forwards.observe(points_m[index], noise_m)
        smoothed[index], deviations[index] = forwards.means()
    for index in reversed(range(len(times_s))):
        backwards.predict(-times_s[index])
        later, later_deviations = backwards.means()
        continued = backwards.observe(points_m[index], noise_m)
        own, other = deviations[index] ** -2.0, np.where(continued, later_deviations, np.inf) ** -2.0
        smoothed[index] = (own[:, None] * smoothed[index] + other[:, None] * later) / (own + other)[:, None]
        deviations[index] = (own + other) ** -0.5
    return np.where(np.isfinite(points_m), smoothed, np.nan), deviations


class _Follower:
    """Kalman filters of several models for each marker."""

    def __init__(self, markers: int) -> None:
        models = len(_DENSITIES)
        self._seen_s = np.full(markers, -np.inf)
        self._time_s = 0.0
        # (M, K, 3, 3) position, velocity, acceleration by axis; (M, K, 3, 3) their covariance, the same for each axis
        self._states, self._covariances = np.zeros((2, markers, models, 3, 3))
        self._weights = np.full((markers, models), 1.0 / models)

    def predict(self, time_s: float) -> None:
        """Move to a later time."""
        self._move(float(np.clip(time_s - self._time_s, 0.0, _PAUSE_S)))
        self._time_s = time_s

    def observe(self, points_m: Array, noise_m: Array) -> Mask:
        """Correct the prediction by markers (M, 3) of known noise (M,).

        Returns:
            Markers (M,) that go on from where they were.
        """
        sigmas_m = np.maximum(noise_m, _LEAST_SIGMA_M)
        located = np.isfinite(points_m[:, 0])
        innovations = np.where(located[:, None], points_m, 0.0)[:, None] - self._states[:, :, 0]
        variances = self._covariances[..., 0, 0] + np.square(sigmas_m)[:, None]
        unlikely = np.sum(innovations**2, axis=-1) / variances
        jumped = np.all((unlikely > _JUMP_SIGMAS**2) & (np.linalg.norm(innovations, axis=-1) > _JUMP_M), axis=1)
        known = (self._time_s - self._seen_s < _PAUSE_S) & ~jumped
        self._update(located & known, innovations, variances, unlikely)
        self._start(located & ~known, points_m, sigmas_m)
        self._seen_s[located] = self._time_s
        return np.asarray(located & known)

    def means(self) -> tuple[Array, Array]:
        """Return positions (M, 3) and the deviations (M,) of their coordinates."""
        positions = self._states[:, :, 0]
        means = (self._weights[:, None] @ positions)[:, 0]
        spread = np.add.reduce((positions - means[:, None]) ** 2, axis=-1) / 3.0
        variances = np.add.reduce(self._weights * (self._covariances[..., 0, 0] + spread), axis=1)
        return means, np.sqrt(np.maximum(variances, 1e-12))

    def _move(self, elapsed_s: float) -> None:
        """Move all models on; each starts from a mixture of all."""
        models = len(_DENSITIES)
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
        self._covariances += _DENSITIES[:, None, None] * (elapsed_s**_POWERS / _DIVISORS)

    def _update(self, seen: Mask, innovations: Array, variances: Array, unlikely: Array) -> None:
        """Correct the models of the seen markers, and how much each counts."""
        gains = self._covariances[seen, :, :, 0] / variances[seen, :, None]
        self._states[seen] += gains[..., None] * innovations[seen][:, :, None]
        self._covariances[seen] -= gains[..., None] * self._covariances[seen, :, :1]
        logs = np.log(np.maximum(self._weights[seen], 1e-300)) - 0.5 * unlikely[seen] - 1.5 * np.log(variances[seen])
        weights = np.exp(logs - logs.max(axis=1, keepdims=True))
        self._weights[seen] = weights / weights.sum(axis=1, keepdims=True)

    def _start(self, new: Mask, points_m: Array, sigmas_m: Array) -> None:
        """Follow markers from where they are."""
        self._states[new] = 0.0
        self._states[new, :, 0] = points_m[new, None]
        self._covariances[new] = 0.0
        self._covariances[new, :, 0, 0] = np.square(sigmas_m[new])[:, None]
        self._covariances[new, :, 1, 1] = _FIRST_SPEED_M_S**2
        self._covariances[new, :, 2, 2] = _FIRST_ACCELERATION_M_S2**2
        self._weights[new] = 1.0 / len(_DENSITIES)
