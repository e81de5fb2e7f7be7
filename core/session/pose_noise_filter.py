"""Trembling that noise of the markers leaves in poses, taken out without delay.

Smoothed markers still move a fitted pose from frame to frame, most of all where few of them hold a joint. Each joint's
turning and the root's path are followed as markers are, by their own noise, so that a still body is still and a fast
one is not late.
"""

import numpy as np

from ..body.body_parts import PART_JOINTS
from ..body.standard_skeleton import JOINT_NAMES
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.multiple_model_filter import MotionModels, MultipleModelFilter
from ..markers.marker_noise import MarkerNoise

# Chosen on eleven takes of people that the database lacks: trembling by 3 mm of noise against accuracy without any.
_TURNING = MotionModels(
    changes=(0.3e-3, 5e-3), least_sigma=0.1e-3, jump=0.15, first_speed=10.0, first_acceleration=100.0
)  # rad
_MOVING = MotionModels(changes=(0.1e-3, 1e-3), least_sigma=0.1e-3, jump=0.05, first_speed=2.0, first_acceleration=20.0)
# A pose's noise lasts over some frames, so its differences from one to the next show a share of it. Pelvis and legs
# are taken as they seem: held closer, feet slide where they land.
_SEEN_SHARES = np.full(len(JOINT_NAMES) + 1, 0.3)
_SEEN_SHARES[0] = 1.0
for _part in ("left leg", "right leg", "left foot", "right foot"):
    _SEEN_SHARES[PART_JOINTS[_part]] = 1.0
_SEEN_SHARES[-1] = 0.5  # the root's path
_UNKNOWN = 1e-3  # rad or m, in the first frames
_MOST = np.append(np.full(len(JOINT_NAMES), 0.05), 0.01)
_PAUSE_S = 0.25
_SLOW_RAD = 0.035  # in one frame, which a joint may always turn


class PoseNoiseFilter:
    """Filters the poses of one body, frame by frame."""

    def __init__(self) -> None:
        self._start_over()
        self._time_s, self._rotations = -np.inf, np.zeros((len(JOINT_NAMES), 4))
        self._calm = self._rotations

    def _start_over(self) -> None:
        joints = len(JOINT_NAMES)
        self._follower, self._noise = MultipleModelFilter((_TURNING, joints), (_MOVING, 1)), MarkerNoise()
        # each joint's turning, rolled out without slipping into space: where its path goes on does not matter
        self._turned_rad = np.zeros((joints, 3))

    def step(self, time_s: float, rotations: Array, root_position_m: Array) -> tuple[Array, Array]:
        """Return rotations (J, 4) and root (3,) without noise; a pause starts over.

        No joint turns further in a frame than without the filter, which passes a bend that comes all at once.
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
