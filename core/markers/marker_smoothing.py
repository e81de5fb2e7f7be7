"""Smoothing of markers by their own noise, without delay.

Each marker is followed by filters for a body that stands, one that moves, one that strikes (`MultipleModelFilter`).
Exact markers pass as they are.
"""

import numpy as np

from ..geometry.arrays import Array
from ..geometry.multiple_model_filter import MotionModels, MultipleModelFilter
from .marker_noise import MarkerNoise, marker_noise

_MODELS = MotionModels(
    changes=(0.01e-3, 0.1e-3, 1e-3),  # of markers that stand, move, strike, m
    least_sigma=0.2e-3,  # skin and optics
    jump=0.05,
    first_speed=2.0,
    first_acceleration=20.0,
)
_UNKNOWN_SIGMA_M = 1e-3  # in the first frames
_MOST_SIGMA_M = 4e-3  # beyond that it is sudden motion at a low rate


class MarkerSmoother:
    """Smooths the markers of one body, frame by frame.

    Args:
        markers: their number M.
    """

    def __init__(self, markers: int) -> None:
        self._noise = MarkerNoise()
        self._follower = MultipleModelFilter((_MODELS, markers))

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
    forwards, backwards = (MultipleModelFilter((_MODELS, points_m.shape[1])) for _ in range(2))
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
