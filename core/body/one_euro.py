"""One-euro filter of poses: removes jitter at the cost of a chosen delay.

The one-euro filter (Casiez, Roussel and Vogel, "1 euro filter: a simple speed-based low-pass filter for noisy input in
interactive systems", CHI 2012): a first-order low-pass with a cutoff that rises with the speed, so that a still pose is
calmed and fast motion is hardly delayed.
"""

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array

_HZ_PER_RAD_S = 1.0
_HZ_PER_M_S = 4.0
_SPEED_HZ = 2.0  # cutoff of the speeds
_PAUSE_S = 0.25  # after so long without a pose it starts over


class PoseSmoother:
    """Smooths poses one after another.

    Args:
        delay_s: by which a slow motion comes later, seconds; a fast one less: 1 / (2 pi) over the cutoff.
    """

    def __init__(self, delay_s: float) -> None:
        self.delay_s = delay_s
        self._last: tuple[float, Array, Array] | None = None

    def step(self, time_s: float, rotations: Array, root_position_m: Array) -> tuple[Array, Array]:
        """Return the next pose's smoothed rotations (J, 4) and root (3,); times ascend."""
        last = self._last
        if self.delay_s <= 0.0 or last is None or not 0.0 < time_s - last[0] < _PAUSE_S:
            self._last = time_s, rotations, root_position_m
            self._raw = rotations, root_position_m
            self._turning = np.zeros((len(rotations), 3))
            self._moving = np.zeros(3)
            return rotations, root_position_m
        passed_s = time_s - last[0]
        (before, root_before), self._raw = self._raw, (rotations, root_position_m)
        share = _share(_SPEED_HZ, passed_s)
        turned = rot.to_rotation_vector(rot.multiply(rotations, rot.conjugate(before))) / passed_s
        self._turning += share * (turned - self._turning)
        self._moving += share * ((root_position_m - root_before) / passed_s - self._moving)
        slowest_hz = 1.0 / (2.0 * np.pi * self.delay_s)
        turn_share = _share(slowest_hz + _HZ_PER_RAD_S * np.linalg.norm(self._turning, axis=-1), passed_s)
        move_share = _share(slowest_hz + _HZ_PER_M_S * float(np.linalg.norm(self._moving)), passed_s)
        smooth = rot.slerp(last[1], rotations, turn_share)
        position = last[2] + move_share * (root_position_m - last[2])
        self._last = time_s, smooth, position
        return smooth, position


def _share(cutoff_hz: Array | float, passed_s: float) -> Array:
    """Return the first-order low-pass's share of the way to a new value."""
    return np.asarray(1.0 - np.exp(-2.0 * np.pi * np.asarray(cutoff_hz) * passed_s))
