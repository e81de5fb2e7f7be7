"""Zero-lag filter for pose jitter caused by marker noise.

Smoothed markers still move a fitted pose from frame to frame, most of all where few of them hold a joint. Each joint's
rotation and the root's position pass a multiple-model filter with their own estimated noise, as markers do: a still
body is still, and a fast one is not delayed.
"""

import numpy as np

from ..body.body_parts import PART_JOINTS
from ..body.standard_skeleton import JOINT_NAMES
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.multiple_model_filter import MotionModels, MultipleModelFilter
from ..markers.marker_noise import MarkerNoise

# Chosen on eleven takes of people not in the database: jitter with 3 mm of noise against accuracy without noise.
_TURNING = MotionModels(
    changes=(0.3e-3, 5e-3), least_sigma=0.1e-3, jump=0.15, first_speed=10.0, first_acceleration=100.0
)  # rad
_MOVING = MotionModels(changes=(0.1e-3, 1e-3), least_sigma=0.1e-3, jump=0.05, first_speed=2.0, first_acceleration=20.0)
# A pose's noise lasts for several frames, so differences between frames show only this share of it. Pelvis and legs
# count in full: if they are filtered more, feet slide when they land.
_SEEN_SHARES = np.full(len(JOINT_NAMES) + 1, 0.3)
_SEEN_SHARES[0] = 1.0
for _part in ("left leg", "right leg", "left foot", "right foot"):
    _SEEN_SHARES[PART_JOINTS[_part]] = 1.0
_SEEN_SHARES[-1] = 0.5  # root position
_UNKNOWN = 1e-3  # noise (rad or m) assumed in the first frames
_MOST = np.append(np.full(len(JOINT_NAMES), 0.05), 0.01)  # largest noise, rad and m
_PAUSE_S = 0.25  # time without a pose after which the filter restarts
_SLOW_RAD = 0.035  # rotation per frame that a joint is always allowed


class PoseNoiseFilter:
    """Filters the poses of one body, frame by frame."""

    def __init__(self) -> None:
        self._start_over()
        self._time_s, self._rotations = -np.inf, np.zeros((len(JOINT_NAMES), 4))
        self._calm = self._rotations

    def _start_over(self) -> None:
        joints = len(JOINT_NAMES)
        self._follower, self._noise = MultipleModelFilter((_TURNING, joints), (_MOVING, 1)), MarkerNoise()
        # unwrapped rotation vectors: sums of the rotations between frames
        self._turned_rad = np.zeros((joints, 3))

    def step(self, time_s: float, rotations: Array, root_position_m: Array) -> tuple[Array, Array]:
        """Return filtered rotations (J, 4) and root position (3,); a pause restarts the filter.

        No joint turns further in a frame than it would without the filter.
        """
        most_rad = np.full(len(rotations), np.inf)
        if 0.0 < time_s - self._time_s < _PAUSE_S:
            turns = rot.to_rotation_vector(rot.multiply(rot.conjugate(self._rotations), rotations))
            self._turned_rad += turns
            most_rad = np.maximum(rot.lengths(turns), _SLOW_RAD)
        else:
            self._start_over()
        self._time_s, self._rotations = time_s, rotations
        path = np.concatenate((self._turned_rad, root_position_m[None]))
        self._follower.predict(time_s)
        seen = self._noise.step(time_s, path)
        self._follower.observe(path, np.minimum(np.where(seen > 0.0, seen / _SEEN_SHARES, _UNKNOWN), _MOST))
        away = self._follower.means()[0] - path
        calm = rot.multiply(rotations, rot.from_rotation_vector(away[:-1]))
        turns = rot.to_rotation_vector(rot.multiply(rot.conjugate(self._calm), calm))
        share = most_rad / np.maximum(rot.lengths(turns), 1e-9)
        late = share < 1.0
        if late.any():
            calm[late] = rot.multiply(self._calm[late], rot.from_rotation_vector(share[late, None] * turns[late]))
        self._calm = calm
        return calm, root_position_m + away[-1]
