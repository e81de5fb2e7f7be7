"""Zero-lag smoothing of markers according to their noise.

Each marker passes a filter with several models, for a marker at rest, moving or striking (`MultipleModelFilter`).
Lasting errors, like those of keypoints, remain in the positions and are included in their standard deviations. Exact
markers are unchanged. A marker that is hidden for a moment is extrapolated, with a growing standard deviation; one on a
standing foot stays where it was. Live, markers that jump are doubted (`JumpGate`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array, Mask
from ..geometry.multiple_model_filter import MotionModels, MultipleModelFilter
from .jump_gate import Carried, Gated, JumpGate, JumpSettings
from .marker_noise import MarkerNoise, marker_noise
from .source_noise import SourceNoise

_MODELS = MotionModels(
    changes=(0.01e-3, 0.1e-3, 1e-3),  # of a marker at rest, moving, striking; m
    least_sigma=0.2e-3,  # due to skin motion and optics
    jump=0.05,
    first_speed=2.0,
    first_acceleration=20.0,
)


@dataclass(frozen=True)
class SmoothingSettings:
    """Settings of `MarkerSmoother` and `smooth_markers`, chosen on development takes of CMU and Bandai-Namco."""

    unknown_sigma_m: float = 1e-3  # noise assumed in the first frames
    sudden: float = 1.75  # factor by which the filters underestimate the error of hidden markers
    known_m: float = 0.09  # largest standard deviation with which a hidden marker is used
    standing_m_s: float = 0.2  # speed below which the marker of a foot stands
    standing_s: float = 0.25  # time for which a hidden marker of a standing foot is assumed to stay
    standing_sigma_m: float = 0.005  # its standard deviation meanwhile


_S = SmoothingSettings()


class SmoothedMarkers(NamedTuple):
    """Markers of one frame."""

    points_m: Array  # (M, 3) smoothed, NaN where unknown
    deviations_m: Array  # (M,) standard deviations of their coordinates
    believed: Gated  # measured markers after the gate


class MarkerSmoother:
    """Smooths the markers of one body, frame by frame.

    Args:
        markers: Number of markers M.
        source: Errors to expect from their source.
        jumps: Settings of the gate for markers that jump.
        feet: Mask (M,) of the markers on feet, which stay in place while hidden if they stood before.
    """

    def __init__(
        self, markers: int, source: SourceNoise, jumps: JumpSettings | None = None, feet: Mask | None = None
    ) -> None:
        self._noise, self._source = MarkerNoise(), source
        self._feet = np.zeros(markers, dtype=bool) if feet is None else feet
        self._stood_m = np.full((markers, 3), np.nan)  # last places of markers that stood when they were last seen
        self._stood_s = np.full(markers, -np.inf)  # times at which they were seen there
        self._follower = MultipleModelFilter(_MODELS, markers)
        self._gate = JumpGate(markers, jumps)
        self._time_s = 0.0

    def step(self, time_s: float, points_m: Array, carried: Carried | None = None) -> SmoothedMarkers:
        """Return the markers of the next frame.

        Args:
            points_m: Markers (M, 3), NaN where hidden; hidden ones are extrapolated for a moment only.
            carried: Prediction from the body so far; with it, markers pass a `JumpGate`; without it, all are used.
        """
        elapsed_s, self._time_s = time_s - self._time_s, time_s
        self._follower.predict(time_s)
        noise_m = np.minimum(self._noise.step(time_s, points_m), self._source.most_fast_m)
        nothing = np.zeros(len(points_m), dtype=bool)
        believed = Gated(points_m, nothing, nothing, nothing)
        if carried is not None:
            most_m = np.where(noise_m > 0.0, noise_m, self._source.most_fast_m)
            believed = self._gate.step(points_m, most_m, self._follower, carried, elapsed_s)
        goes_on = _observe(self._follower, believed.points_m, np.where(noise_m > 0.0, noise_m, _S.unknown_sigma_m))
        smoothed_m, deviations_m = _known(believed.points_m, *self._follower.means(), goes_on)
        standing = self._standing(believed.points_m, smoothed_m)
        smoothed_m = np.where(standing[:, None], self._stood_m, smoothed_m)
        deviations_m = np.where(standing, _S.standing_sigma_m, deviations_m)
        return SmoothedMarkers(smoothed_m, np.hypot(deviations_m, self._source.lasting_m), believed)

    def _standing(self, points_m: Array, smoothed_m: Array) -> Mask:
        """Return a mask (M,) of hidden markers that are assumed to stand where they were last seen."""
        located = np.isfinite(points_m[:, 0])
        stands = located & self._feet & (self._follower.speeds() < _S.standing_m_s)
        self._stood_m[stands] = smoothed_m[stands]
        self._stood_s[located] = np.where(stands[located], self._time_s, -np.inf)
        return np.asarray(~located & (self._time_s - self._stood_s < _S.standing_s))


def smooth_markers(times_s: Array, points_m: Array, source: SourceNoise) -> tuple[Array, Array]:
    """Return a take's markers (F, M, 3), smoothed in both directions, and their standard deviations (F, M).

    A forward and a backward filter are combined (Fraser and Potter 1969).

    Args:
        times_s: Ascending times (F,).
        points_m: Markers (F, M, 3), NaN where hidden; hidden ones are extrapolated for a moment only.
        source: Errors to expect from their source.
    """
    noise_m = np.minimum(marker_noise(times_s, points_m), source.most_fast_m)
    smoothed, deviations = np.full(points_m.shape, np.nan), np.full(points_m.shape[:2], np.inf)
    forwards, backwards = (MultipleModelFilter(_MODELS, points_m.shape[1]) for _ in range(2))
    for index, time_s in enumerate(times_s):
        forwards.predict(time_s)
        known = _observe(forwards, points_m[index], noise_m) | np.isfinite(points_m[index, :, 0])
        smoothed[index], own = forwards.means()
        deviations[index] = np.where(known, own, np.inf)
    for index in reversed(range(len(times_s))):
        backwards.predict(-times_s[index])
        later, later_deviations = backwards.means()
        goes_on = _observe(backwards, points_m[index], noise_m)
        own, other = deviations[index] ** -2.0, np.where(goes_on, later_deviations, np.inf) ** -2.0
        both = np.maximum(own + other, 1e-12)
        mean = (own[:, None] * smoothed[index] + other[:, None] * later) / both[:, None]
        smoothed[index], deviations[index] = _known(points_m[index], mean, both**-0.5, own + other > 0.0)
    return smoothed, np.hypot(deviations, source.lasting_m)


def _observe(follower: MultipleModelFilter, points_m: Array, noise_m: Array) -> Mask:
    """Correct a filter's prediction; return a mask (M,) of the markers that continue their motion.

    If any marker has jumped, hidden markers are assumed not to continue theirs.
    """
    followed, located = follower.followed, np.isfinite(points_m[:, 0])
    continued = follower.observe(points_m, noise_m)
    if np.any(followed & located & ~continued):
        follower.forget(~located)
        return continued
    return continued | (followed & ~located)


def _known(points_m: Array, means_m: Array, deviations_m: Array, goes_on: Mask) -> tuple[Array, Array]:
    """Return means, NaN for hidden markers that are no longer known well, and deviations."""
    located = np.isfinite(points_m[:, 0])
    deviations_m = np.where(located, 1.0, _S.sudden) * deviations_m
    known = located | (goes_on & (deviations_m < _S.known_m))
    return np.where(known[:, None], means_m, np.nan), deviations_m
