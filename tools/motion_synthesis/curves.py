"""Smooth curves through keys, as in an animator's graph editor, and other functions of time."""

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_SAME_S = 1e-6


class Key(NamedTuple):
    """A value at a time; also velocity and acceleration if they are fixed."""

    time_s: float
    value: Array
    velocity: ArrayLike | None
    acceleration: ArrayLike | None


class Track:
    """Keys of one quantity; a C2 curve between them, constant before and after.

    Tangents are monotone (no overshoot between keys, level at extremes) unless a key fixes its velocity and
    acceleration, so a ballistic flight between two keys is reproduced exactly.
    """

    def __init__(self) -> None:
        self.keys: list[Key] = []  # sorted by time

    def key(
        self,
        time_s: float,
        value: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set a key; a key at the same time is replaced."""
        begin, end = (bisect_left(self.keys, time_s + side, key=lambda key: key.time_s) for side in (-_SAME_S, _SAME_S))
        array = np.atleast_1d(np.asarray(value, dtype=np.float64))
        self.keys[begin:end] = [Key(time_s, array, velocity, acceleration)]

    def value_at(self, time_s: float) -> Array:
        """Return the value (n,) at one time."""
        return self.sample(np.array([time_s]))[0]

    def sample(self, times_s: Array) -> Array:
        """Return the curve at the times, (T, n)."""
        times, values = np.array([key.time_s for key in self.keys]), np.stack([key.value for key in self.keys])
        if len(times) == 1:
            return np.repeat(values, len(times_s), axis=0)
        velocities, accelerations = _tangents(times, values, self.keys)
        at = np.clip(times_s, times[0], times[-1])
        i = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
        h = (times[i + 1] - times[i])[:, None]
        u = (at - times[i])[:, None] / h
        # quintic Hermite curve for each segment
        p0, v0, a0 = values[i], velocities[i] * h, accelerations[i] * h * h
        p1, v1, a1 = values[i + 1], velocities[i + 1] * h, accelerations[i + 1] * h * h
        d, e, f = p1 - p0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
        c3, c4, c5 = 10.0 * d - 4.0 * e + 0.5 * f, -15.0 * d + 7.0 * e - f, 6.0 * d - 3.0 * e + 0.5 * f
        return p0 + u * (v0 + u * (0.5 * a0 + u * (c3 + u * (c4 + u * c5))))


def _tangents(times: Array, values: Array, keys: Sequence[Key]) -> tuple[Array, Array]:
    """Return velocities and accelerations at the keys, monotone where not fixed."""
    steps = np.diff(times)[:, None]
    slopes = np.diff(values, axis=0) / steps
    velocities, accelerations = np.zeros_like(values), np.zeros_like(values)
    before, after = slopes[:-1], slopes[1:]
    # weighted harmonic mean (Fritsch and Butland 1984): monotone, zero at extremes
    w1, w2 = 2.0 * steps[1:] + steps[:-1], steps[1:] + 2.0 * steps[:-1]
    same = before * after > 0.0
    safe = np.where(same, w1 * after + w2 * before, 1.0)
    velocities[1:-1] = np.where(same, (w1 + w2) * before * after / safe, 0.0)
    for i, key in enumerate(keys):
        if key.velocity is not None:
            velocities[i] = key.velocity
    # second derivatives of the cubics that meet at a key; the smaller if they agree in sign, so holds stay level
    left = (2.0 * velocities[:-1] + 4.0 * velocities[1:] - 6.0 * slopes) / steps
    right = (6.0 * slopes - 4.0 * velocities[:-1] - 2.0 * velocities[1:]) / steps
    smaller = np.sign(left[:-1]) * np.minimum(np.abs(left[:-1]), np.abs(right[1:]))
    accelerations[1:-1] = np.where(left[:-1] * right[1:] > 0.0, smaller, 0.0)
    for i, key in enumerate(keys):
        if key.acceleration is not None:
            accelerations[i] = key.acceleration
    return velocities, accelerations


def ease(u: ArrayLike) -> Array:
    """Return the minimum-jerk blend (Flash and Hogan 1985) of u, clamped to 0..1."""
    s = np.clip(np.asarray(u, dtype=np.float64), 0.0, 1.0)
    return s**3 * (10.0 + s * (-15.0 + 6.0 * s))


def _convolved(values: Array, kernel: Array) -> Array:
    """Return values (T, ...) convolved with a kernel of odd length, with constant ends."""
    reach = len(kernel) // 2
    padded = np.concatenate((values[:1].repeat(reach, axis=0), values, values[-1:].repeat(reach, axis=0)))
    columns = padded.reshape(len(padded), -1).T
    return np.array([np.convolve(column, kernel, "valid") for column in columns]).T.reshape(values.shape)


def smoothed(values: Array, sigma_samples: float) -> Array:
    """Return values (T,) smoothed with a Gaussian, with constant ends."""
    reach = int(np.ceil(4.0 * sigma_samples))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_samples) ** 2)
    return _convolved(values, kernel / kernel.sum())


def pendulum_filtered(values: Array, rate_per_s: float, step_s: float) -> Array:
    """Return the balanced path of a body over the support path `values` (T, n).

    The bounded solution of the linear inverted pendulum x'' = w^2 (x - p) is p convolved with (w/2) exp(-w |t|)
    (Kajita et al. 2001); `rate_per_s` is w = sqrt(g / height).
    """
    reach = int(np.ceil(5.0 / (rate_per_s * step_s)))
    kernel = np.exp(-rate_per_s * step_s * np.abs(np.arange(-reach, reach + 1)))
    return _convolved(values, kernel / kernel.sum())


def wander(rng: np.random.Generator, times_s: Array, size: int) -> Array:
    """Return smooth noise (T, size) of unit standard deviation.

    Sines of random period (0.6 to 4 s) and phase; amplitudes fall with the frequency, as in human sway.
    """
    waves = 7
    periods = np.exp(rng.uniform(np.log(0.6), np.log(4.0), (waves, size)))
    phases = rng.uniform(0.0, 2.0 * np.pi, (waves, size))
    amplitudes = periods**0.7
    amplitudes *= np.sqrt(2.0) / np.linalg.norm(amplitudes, axis=0)
    return np.asarray((amplitudes * np.sin(2.0 * np.pi * times_s[:, None, None] / periods + phases)).sum(axis=1))
