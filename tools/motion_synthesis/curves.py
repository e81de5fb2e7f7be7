"""Smooth curves through keys, as in an animator's graph editor.

Default tangents are monotone (no overshoot between keys, level at extremes); a key may fix its own velocity and
acceleration, so a ballistic flight between two keys with acceleration -g is reproduced exactly.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_SAME_S = 1e-6


class Key(NamedTuple):
    """A value at a time, with its velocity and acceleration where they are fixed."""

    time_s: float
    value: Array
    velocity: Array | None
    acceleration: Array | None


@dataclass
class Track:
    """Keys of one quantity; a C2 curve between the ends and constant beyond."""

    keys: list[Key] = field(default_factory=list)  # by time

    def key(
        self,
        time_s: float,
        value: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set a key; one at the same time is replaced."""
        begin, end = (bisect_left(self.keys, time_s + side, key=_time_s) for side in (-_SAME_S, _SAME_S))
        self.keys[begin:end] = [Key(time_s, _vector(value), _optional(velocity), _optional(acceleration))]

    def last(self) -> Key:
        """Return the key with the greatest time."""
        return self.keys[-1]

    def value_at(self, time_s: float) -> Array:
        """Return the value (n,) at one time."""
        after = bisect_right(self.keys, time_s, key=_time_s)
        # tangents and curvature at both ends of a segment come from the keys up to two beyond
        return _sampled(self.keys[max(after - 3, 0) : after + 3], np.array([time_s]))[0]

    def sample(self, times_s: Array) -> Array:
        """Return the curve at the times, (T, n)."""
        return _sampled(self.keys, times_s)


def _time_s(key: Key) -> float:
    return key.time_s


def _sampled(keys: Sequence[Key], times_s: Array) -> Array:
    times = np.array([k.time_s for k in keys])
    values = np.stack([k.value for k in keys])
    if len(keys) == 1:
        return np.repeat(values, len(times_s), axis=0)
    velocities, accelerations = _tangents(times, values, keys)
    at = np.clip(times_s, times[0], times[-1])
    segment = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    return _quintic(at, segment, times, values, velocities, accelerations)


def _vector(value: ArrayLike) -> Array:
    return np.atleast_1d(np.asarray(value, dtype=np.float64))


def _optional(value: ArrayLike | None) -> Array | None:
    return None if value is None else _vector(value)


def _tangents(times: Array, values: Array, keys: Sequence[Key]) -> tuple[Array, Array]:
    """Return velocities and accelerations at the keys, monotone where not fixed."""
    steps = np.diff(times)[:, None]
    slopes = np.diff(values, axis=0) / steps
    velocities = np.zeros_like(values)
    before, after = slopes[:-1], slopes[1:]
    # weighted harmonic mean (Fritsch and Butland 1984): monotone, zero at extremes
    w1, w2 = 2.0 * steps[1:] + steps[:-1], steps[1:] + 2.0 * steps[:-1]
    same = before * after > 0.0
    safe = np.where(same, w1 * after + w2 * before, 1.0)
    velocities[1:-1] = np.where(same, (w1 + w2) * before * after / safe, 0.0)
    for i, key in enumerate(keys):
        if key.velocity is not None:
            velocities[i] = key.velocity
    accelerations = np.zeros_like(values)
    # second derivatives of the cubics that meet at a key; the smaller where they agree in sign, so holds stay level
    left = (2.0 * velocities[:-1] + 4.0 * velocities[1:] - 6.0 * slopes) / steps
    right = (6.0 * slopes - 4.0 * velocities[:-1] - 2.0 * velocities[1:]) / steps
    agree = left[:-1] * right[1:] > 0.0
    smaller = np.sign(left[:-1]) * np.minimum(np.abs(left[:-1]), np.abs(right[1:]))
    accelerations[1:-1] = np.where(agree, smaller, 0.0)
    for i, key in enumerate(keys):
        if key.acceleration is not None:
            accelerations[i] = key.acceleration
    return velocities, accelerations


def _quintic(at: Array, segment: NDArray[np.intp], times: Array, p: Array, v: Array, a: Array) -> Array:
    """Return the quintic Hermite curve at `at`, each in its segment."""
    h = (times[segment + 1] - times[segment])[:, None]
    u = (at - times[segment])[:, None] / h
    p0, p1, v0, v1 = p[segment], p[segment + 1], v[segment] * h, v[segment + 1] * h
    a0, a1 = a[segment] * h * h, a[segment + 1] * h * h
    d, e, f = p1 - p0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    c3 = 10.0 * d - 4.0 * e + 0.5 * f
    c4 = -15.0 * d + 7.0 * e - f
    c5 = 6.0 * d - 3.0 * e + 0.5 * f
    return p0 + u * (v0 + u * (0.5 * a0 + u * (c3 + u * (c4 + u * c5))))


def ease(u: ArrayLike) -> Array:
    """Return the minimum-jerk blend (Flash and Hogan 1985) of u, clamped to 0..1."""
    s = np.clip(np.asarray(u, dtype=np.float64), 0.0, 1.0)
    return s**3 * (10.0 + s * (-15.0 + 6.0 * s))


def smoothed(values: Array, sigma_samples: float) -> Array:
    """Return values (T, ...) after a Gaussian along the first axis, the ends held."""
    reach = int(np.ceil(4.0 * sigma_samples))
    if reach == 0:
        return values
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_samples) ** 2)
    return _convolved(values, kernel / kernel.sum(), reach)


def pendulum_filtered(values: Array, rate_per_s: float, step_s: float) -> Array:
    """Return the balanced path of a body over the support path `values` (T, n).

    The bounded solution of the linear inverted pendulum x'' = w^2 (x - p) is p convolved with (w/2) exp(-w |t|)
    (Kajita et al. 2001); `rate_per_s` is w = sqrt(g / height).
    """
    reach = int(np.ceil(5.0 / (rate_per_s * step_s)))
    kernel = np.exp(-rate_per_s * step_s * np.abs(np.arange(-reach, reach + 1)))
    return _convolved(values, kernel / kernel.sum(), reach)


def _convolved(values: Array, kernel: Array, reach: int) -> Array:
    flat = values.reshape(len(values), -1)
    padded = np.concatenate((np.repeat(flat[:1], reach, axis=0), flat, np.repeat(flat[-1:], reach, axis=0)))
    columns = [np.convolve(padded[:, i], kernel, mode="valid") for i in range(flat.shape[1])]
    return np.stack(columns, axis=1).reshape(values.shape)


def wander(rng: np.random.Generator, times_s: Array, size: int, slowest_s: float, fastest_s: float) -> Array:
    """Return smooth noise (T, size) of unit standard deviation.

    Sines of random period and phase; amplitudes fall with the frequency, as in human sway.
    """
    waves = 7
    periods = np.exp(rng.uniform(np.log(fastest_s), np.log(slowest_s), (waves, size)))
    phases = rng.uniform(0.0, 2.0 * np.pi, (waves, size))
    amplitudes = periods**0.7
    amplitudes *= np.sqrt(2.0) / np.linalg.norm(amplitudes, axis=0)
    waves_at = np.sin(2.0 * np.pi * times_s[:, None, None] / periods + phases)
    return np.asarray((amplitudes * waves_at).sum(axis=1))
