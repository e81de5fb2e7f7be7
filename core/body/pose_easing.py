"""Easing of poses: a joint that jumps takes a quarter second to its new place.

A marker that comes back, or a better explanation of the same markers, moves a joint faster than a body can. The
difference to the continued motion is kept as an offset, which is then let go ("Inertialization", Bollo, GDC 2018): what
follows moves as it was solved. Where the markers themselves are elsewhere at once there is nothing to ease: that is
another person, or the same one after a gap.
"""

from collections import deque

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask

_SUDDEN_RAD = np.radians(8.0)  # beyond the continued motion, from one frame of 60 a second to the next,
_SUDDEN_AT_CHANGE_RAD = np.radians(5.0)  # on a limb with a marker that comes or goes
_FRAME_S = 1.0 / 60.0
_AFTER_JUMP = 0.5  # share of the earlier turning with which a joint goes on
_LET_GO_S = 0.06  # in which an offset falls to 1/e,
_LET_GO_RAD_S = np.radians(240.0)  # no faster than this
_PAUSE_S = 0.25  # after so long without a pose it starts over
_CUT_M = 0.15  # between two frames of 60 a second no marker moves so far from where it was lately:
_CUT_SHARE, _CUT_MARKERS = 0.2, 2  # as several have, it is a cut
_EXCHANGED_M = 0.05  # in the same time, from the earlier place of another with its label


class PoseEaser:
    """Eases the joints of poses one after another; the root's rotation stays.

    Args:
        parents: (J,) of the joints.
        carriers: (M,) joint of each marker.
    """

    def __init__(self, parents: IntArray, carriers: IntArray) -> None:
        above = np.eye(len(parents), dtype=np.bool_)  # of a joint: itself and those that carry it
        for joint in range(1, len(parents)):
            above[joint] |= above[parents[joint]]
        self._limbs: Mask = (above | above.T)[carriers]
        self.reset()

    def reset(self) -> None:
        """Show the next pose as it is."""
        self._time_s = float("nan")

    def step(self, time_s: float, rotations: Array, points_m: Array, held: bool = False) -> Array:
        """Return the next pose's eased rotations (J, 4).

        Args:
            points_m: (M, 3) located markers, NaN where not.
            held: keep the joints where they are.
        """
        passed_s = time_s - self._time_s
        if not 0.0 < passed_s < _PAUSE_S or self._is_cut(passed_s, points_m):
            self._rate = np.zeros((len(rotations), 3))
            self._solved_rates = (self._rate, self._rate)
            self._offset_rad = np.zeros(len(rotations))
            self._shown, self._trail = rotations, deque[tuple[float, Array]]()
        else:
            changed = np.isfinite(points_m[:, 0]) != np.isfinite(self._trail[-1][1][:, 0])
            self._shown = self._eased(passed_s, rotations, self._limbs[changed].any(axis=0), held)
        self._time_s, self._raw = time_s, rotations
        self._trail.append((time_s, points_m))
        while time_s - self._trail[0][0] > _PAUSE_S:
            self._trail.popleft()
        return self._shown

    def _is_cut(self, passed_s: float, points_m: Array) -> bool:
        """Return whether several markers are far from where they were lately."""
        frames = max(1.0, passed_s / _FRAME_S)
        lately_m = np.stack([earlier_m for _, earlier_m in self._trail])
        far = np.fmin.reduce(np.linalg.norm(points_m - lately_m, axis=-1)) > _CUT_M * frames
        # markers that exchange labels are where one of them was
        others_m = np.linalg.norm(points_m[far, None] - lately_m[:, far].reshape(-1, 3), axis=-1)
        moved = np.sum(np.fmin.reduce(others_m, axis=1, initial=np.inf) > _EXCHANGED_M * frames)
        return bool(moved >= max(_CUT_MARKERS, _CUT_SHARE * np.isfinite(points_m[:, 0]).sum()))

    def _eased(self, passed_s: float, rotations: Array, changed: Mask, held: bool) -> Array:
        rate = _turn(self._raw, rotations) / passed_s
        sudden = self._is_sudden(rate, passed_s, np.where(changed, _SUDDEN_AT_CHANGE_RAD, _SUDDEN_RAD))
        self._solved_rates = self._solved_rates[1], rate
        # a jump is no motion that goes on, and the one before it ends
        self._rate = np.where(sudden[:, None], _AFTER_JUMP * self._rate, rate)
        offset = _turn(rotations, rot.multiply(self._shown, rot.from_rotation_vector(self._rate * passed_s)))
        if held:
            offset = _turn(rotations, self._shown)
        elif not sudden.any() and not self._offset_rad.any():
            return rotations
        offset[0] = 0.0
        angle = np.linalg.norm(offset, axis=-1)
        less = np.minimum(angle * (1.0 - np.exp(-passed_s / _LET_GO_S)), _LET_GO_RAD_S * passed_s)
        left = angle if held else angle - less
        self._offset_rad = np.where(left < 1e-3, 0.0, left)
        offset *= (self._offset_rad / np.maximum(angle, 1e-12))[:, None]
        return rot.multiply(rotations, rot.from_rotation_vector(offset))

    def _is_sudden(self, rate: Array, passed_s: float, limit_rad: Array) -> Mask:
        """Return (J,) true for joints that neither go on as before nor as for two frames."""
        limit_rad = limit_rad * max(1.0, (passed_s / _FRAME_S) ** 2)
        as_shown, *as_solved = (
            np.linalg.norm(rate - known, axis=-1) * passed_s <= limit_rad for known in (self._rate, *self._solved_rates)
        )
        sudden: Mask = ~(as_shown | (as_solved[0] & as_solved[1]))
        return sudden


def _turn(start: Array, end: Array) -> Array:
    """Return rotation vectors (J, 3) between rotations, in the joints' frames."""
    return np.asarray(rot.to_rotation_vector(rot.multiply(rot.conjugate(start), end)))
