"""Trembling that noise of the markers leaves in poses, taken out without delay.

Smoothed markers still move a fitted pose from frame to frame, most of all where few of them hold a joint. Each joint's
turning and the root's path are followed as markers are, by their own noise, so that a still body is still and a fast
one is not late.
"""

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.multiple_model_filter import MotionModels, MultipleModelFilter, smooth_paths
from ..markers.marker_noise import MarkerNoise, marker_noise

# Chosen on eleven takes of people that the database lacks: trembling by 3 mm of noise against accuracy without any.
_TURNING = MotionModels(
    changes=(0.3e-3, 5e-3), least_sigma=0.1e-3, jump=0.15, first_speed=10.0, first_acceleration=100.0
)  # rad
_MOVING = MotionModels(changes=(0.1e-3, 1e-3), least_sigma=0.1e-3, jump=0.05, first_speed=2.0, first_acceleration=20.0)
# A pose's noise lasts over some frames; what differs from one frame to the next is less than the whole.
_SHARE_SEEN = 0.3
_UNKNOWN_RAD, _MOST_RAD, _MOST_M = 1e-3, 0.05, 0.01
_PAUSE_S = 0.25


class PoseNoiseFilter:
    """Filters the poses of one body, frame by frame.

    Args:
        joints: their number J, the root first.
    """

    def __init__(self, joints: int) -> None:
        self._start_over(joints)
        self._time_s, self._rotations = -np.inf, np.zeros((joints, 4))

    def _start_over(self, joints: int) -> None:
        self._follower, self._noise = _follower(joints), MarkerNoise()
        # each joint's turning, rolled out without slipping into space: where its path goes on does not matter
        self._turned_rad = np.zeros((joints, 3))

    def step(self, time_s: float, rotations: Array, root_position_m: Array) -> tuple[Array, Array]:
        """Return rotations (J, 4) and root (3,) without noise; a pause starts over."""
        if 0.0 < time_s - self._time_s < _PAUSE_S:
            self._turned_rad += _turns(self._rotations, rotations)
        else:
            self._start_over(len(rotations))
        self._time_s, self._rotations = time_s, rotations
        path = np.concatenate((self._turned_rad, root_position_m[None]))
        self._follower.predict(time_s)
        self._follower.observe(path, _whole_noise(self._noise.step(time_s, path)))
        away = self._follower.means()[0] - path
        return rot.multiply(rotations, rot.from_rotation_vector(away[:-1])), root_position_m + away[-1]


def without_noise(times_s: Array, rotations: Array, root_positions_m: Array) -> tuple[Array, Array]:
    """Return rotations (F, J, 4) and root (F, 3) of a stretch without noise.

    By earlier and later ones.

    Args:
        times_s: (F,) ascending, without a pause.
    """
    frames, joints = rotations.shape[:2]
    turned_rad = np.zeros((frames, joints, 3))
    np.cumsum(_turns(rotations[:-1], rotations[1:]), axis=0, out=turned_rad[1:])
    path = np.concatenate((turned_rad, root_positions_m[:, None]), axis=1)
    noise = _whole_noise(marker_noise(times_s, path))
    away = smooth_paths(times_s, path, noise, lambda: _follower(joints))[0] - path
    return rot.multiply(rotations, rot.from_rotation_vector(away[:, :-1])), root_positions_m + away[:, -1]


def _follower(joints: int) -> MultipleModelFilter:
    return MultipleModelFilter((_TURNING, joints), (_MOVING, 1))


def _turns(before: Array, after: Array) -> Array:
    return rot.to_rotation_vector(rot.multiply(rot.conjugate(before), after))


def _whole_noise(seen: Array) -> Array:
    """Return the noise (J + 1,) of a path from the differences between frames."""
    noise = np.where(seen > 0.0, seen / _SHARE_SEEN, _UNKNOWN_RAD)
    return np.minimum(noise, np.append(np.full(len(noise) - 1, _MOST_RAD), _MOST_M))
