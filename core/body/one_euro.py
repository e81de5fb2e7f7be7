"""One-euro filter for poses: removes jitter at the cost of a chosen delay.

Casiez, Roussel and Vogel, "1 euro filter: a simple speed-based low-pass filter for noisy input in interactive systems",
CHI 2012: a first-order low-pass filter whose cutoff rises with the speed, so that it calms still poses and hardly
delays fast motion.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .clock import PAUSE_S


@dataclass(frozen=True)
class OneEuroSettings:
    """Cutoffs of the filter."""

    hz_per_rad_s: float = 1.0  # increase of the cutoff with the speed of a rotation
    hz_per_m_s: float = 4.0  # increase of the cutoff with the speed of the root
    speed_hz: float = 2.0  # cutoff of the filter for speeds


_SETTINGS = OneEuroSettings()


class PoseSmoother:
    """Smooths poses one after another.

    Args:
        delay_s: Delay of slow motion; it falls with the speed, as 1 / (2 pi cutoff).
    """

    def __init__(self, delay_s: float) -> None:
        self.delay_s = delay_s
        self._last: tuple[float, Array, Array] | None = None

    def step(self, time_s: float, rotations: Array, root_position_m: Array) -> tuple[Array, Array]:
        """Return the next pose's smoothed rotations (J, 4) and root position (3,); times must ascend."""
        last = self._last
        if self.delay_s <= 0.0 or last is None or not 0.0 < time_s - last[0] < PAUSE_S:
            self._last = time_s, rotations, root_position_m
            self._raw = rotations, root_position_m
            self._turning = np.zeros((len(rotations), 3))
            self._moving = np.zeros(3)
            return rotations, root_position_m
        passed_s = time_s - last[0]
        (before, root_before), self._raw = self._raw, (rotations, root_position_m)
        share = _share(_SETTINGS.speed_hz, passed_s)
        turned = rot.to_rotation_vector(rot.multiply(rotations, rot.conjugate(before))) / passed_s
        self._turning += share * (turned - self._turning)
        self._moving += share * ((root_position_m - root_before) / passed_s - self._moving)
        slowest_hz = 1.0 / (2.0 * np.pi * self.delay_s)
        turn_share = _share(slowest_hz + _SETTINGS.hz_per_rad_s * np.linalg.norm(self._turning, axis=-1), passed_s)
        move_share = _share(slowest_hz + _SETTINGS.hz_per_m_s * float(np.linalg.norm(self._moving)), passed_s)
        smooth = rot.slerp(last[1], rotations, turn_share)
        position = last[2] + move_share * (root_position_m - last[2])
        self._last = time_s, smooth, position
        return smooth, position


def _share(cutoff_hz: Array | float, passed_s: float) -> Array:
    """Return the fraction of the way to a new value that a first-order low-pass filter moves."""
    return np.asarray(1.0 - np.exp(-2.0 * np.pi * np.asarray(cutoff_hz) * passed_s))
