"""Signals that a performer gives with the hands: a raised hand, or two claps."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ..body.scene_pose import PerformerPose
from ..body.skeleton import Skeleton, forward_kinematics
from ..geometry.arrays import Array


class Gesture(Enum):
    """Signals of a performer."""

    RAISED_HAND = "raise a hand"
    CLAPS = "clap twice"


@dataclass(frozen=True)
class GestureSettings:
    """Limits for signals, chosen so that walking, boxing and sword play do not give them."""

    above_m: float = 0.15  # height of the raised hand's joint above the head's
    other_m: float = -0.35  # largest height of the other hand: acting often raises both
    raised_s: float = 1.0  # time for which one hand must be raised
    together_m: float = 0.16  # distance between the hands' joints in a clap
    apart_m: float = 0.3  # distance to which they must part before the next clap
    even: float = 0.6  # least way of one hand from the clap, relative to the other's: a punch leaves one hand behind
    claps_s: float = 0.8  # longest time between two claps
    lasts_s: float = 2.0  # time from the beginning of a gesture to its recognition, cut from the end of a recording


GESTURES = GestureSettings()


class GestureWatch:
    """Recognises a signal in successive poses; each is given once."""

    def __init__(self, skeleton: Skeleton, gesture: Gesture) -> None:
        self._skeleton = skeleton
        self._joints = [skeleton.index(name) for name in ("head", "lhand", "rhand")]
        recognise: dict[Gesture, Callable[[float, Array], bool]] = {
            Gesture.RAISED_HAND: self._is_raised,
            Gesture.CLAPS: self._has_clapped,
        }
        self._recognise = recognise[gesture]
        self._since_s: float | None = None  # time since which a hand is raised
        self._is_armed = True  # the hands were down, or apart, since the last signal or clap
        self._clapped_s = -np.inf
        self._clap_m = np.zeros(3)  # where the hands last met

    def step(self, pose: PerformerPose) -> bool:
        """Return whether the performer gives the signal in this pose; doubtful poses give none."""
        if pose.doubtful:
            return False
        places_m, _ = forward_kinematics(self._skeleton, pose.rotations, pose.root_position_m)
        return self._recognise(pose.time_s, places_m[self._joints])

    def _is_raised(self, time_s: float, places_m: Array) -> bool:
        lower_m, upper_m = np.sort(places_m[1:, 1] - places_m[0, 1])
        if upper_m < GESTURES.above_m or lower_m > GESTURES.other_m:
            self._since_s = None
            self._is_armed = self._is_armed or bool(upper_m < 0.0)
            return False
        self._since_s = time_s if self._since_s is None else self._since_s
        if not self._is_armed or time_s - self._since_s < GESTURES.raised_s:
            return False
        self._is_armed = False
        return True

    def _has_clapped(self, time_s: float, places_m: Array) -> bool:
        apart_m = float(np.linalg.norm(places_m[1] - places_m[2]))
        if apart_m > GESTURES.apart_m and not self._is_armed:
            ways_m = np.linalg.norm(places_m[1:] - self._clap_m, axis=1)
            self._is_armed = bool(ways_m.min() > GESTURES.even * ways_m.max())
        if not self._is_armed or apart_m > GESTURES.together_m:
            return False
        self._is_armed, self._clap_m = False, places_m[1:].mean(axis=0)
        is_second = time_s - self._clapped_s <= GESTURES.claps_s
        self._clapped_s = -np.inf if is_second else time_s
        return is_second
