"""Foot lock: standing feet are found and the legs bent to hold them.

The ball of the foot is held (the toes' joint), as the heel is lifted long before a step ends. The way from the
pose's ball to the held one is added to the ankle, and hip and knee are turned to reach it in the plane of the leg (a
chain of two bones in closed form, by the law of cosines); the foot keeps its direction in the room. On release that way
fades out, so nothing jumps.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import SettingsError
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.camera import CameraRig
from ..geometry.two_bone_ik import reach_with_two_bones
from .calibration_poses import standing
from .motion import Motion
from .skeleton import Skeleton, forward_kinematics

FEET = ("off", "auto", "always")

_SOLE_M = 0.02  # from the lowest joint of a standing foot down to the floor
_WINDOW_S = 0.06  # over which a speed is taken: one frame's is mostly noise
_PLANTED_M_S, _LIFTED_M_S = 0.2, 0.4  # a standing foot moves less, one that leaves more
_PLANTED_M, _LIFTED_M = 0.05, 0.09  # the same of heights above where the ball of a standing foot is
_REACH_M = 0.05  # a foot that would have to be held further off has moved in truth
_GLIDE_REACH_M = 0.30  # the same where it is held although it glides
_LOWER_M = 0.02  # a foot must be lower than the held one by this to take its place
_FADE_S = 0.12
_STRETCH = 0.995  # of the leg, up to which it may be straightened: near a straight knee millimetres turn it by degrees
_KNEE_AXIS = np.array([1.0, 0.0, 0.0])  # of a straight leg: to the performer's left in the rest pose
_PAUSE_S = 0.25  # after so long without a pose everything starts over
_LOWEST_PERCENT = 5.0  # of a motion's frames, taken as the floor: single frames are noise


def floor_of(rig: CameraRig | None) -> float | None:
    """Return the floor's height in a calibration's world, None if unknown."""
    return 0.0 if rig is not None and rig.metadata.get("floor") else None


def hold_feet(motion: Motion, mode: str, floor_m: float | None) -> Motion:
    """Return a motion with its feet held; arguments and errors as of `FootLock`.

    Without a known floor it is taken to be where the lower foot most often stands.
    """
    if mode == "off":
        return motion
    if floor_m is None:
        skeleton = motion.skeleton
        balls = [skeleton.index(side + "toes") for side in "lr"]
        heights = forward_kinematics(skeleton, motion.rotations, motion.root_positions_m)[0][:, balls, 1]
        floor_m = float(np.percentile(heights.min(axis=1), _LOWEST_PERCENT)) - _standing_heights(skeleton)[0]
    lock = FootLock(motion.skeleton, mode, floor_m)
    frames = zip(motion.rotations, motion.root_positions_m, strict=True)
    held = [lock.step(i / motion.fps, rotations, root) for i, (rotations, root) in enumerate(frames)]
    return replace(motion, rotations=np.array(held))


def _within(reach_m: float, start: Array, end: Array) -> Array:
    """Return the end (3,), or the point so far on the way to it."""
    way = end - start
    away_m = float(np.linalg.norm(way))
    return end if away_m <= reach_m else start + way * (reach_m / away_m)


def _standing_heights(skeleton: Skeleton) -> tuple[float, float]:
    """Return the heights of a standing person's left and right ball of the foot."""
    heights = forward_kinematics(skeleton, standing(skeleton), np.zeros(3))[0][:, 1]
    found = []
    for side in "lr":
        ankle, ball = heights[skeleton.index(side + "foot")], heights[skeleton.index(side + "toes")]
        found.append(float(ball - min(ankle, ball)) + _SOLE_M)
    return found[0], found[1]


@dataclass
class _Foot:
    """One leg's joints, and where its foot is held."""

    femur: int
    tibia: int
    foot: int
    toes: int
    stand_m: float  # height of the ball when standing
    past: list[tuple[float, Array]] = field(default_factory=list)
    anchor_m: Array | None = None
    offset_m: Array = field(default_factory=lambda: np.zeros(3))

    def forget(self) -> None:
        self.past, self.anchor_m, self.offset_m = [], None, np.zeros(3)


class FootLock:
    """Holds feet in place.

    Args:
        mode: "off", "auto" (a foot that is low and slow stands until it is lifted or moves off), or "always" (the lower
            foot stands even if it glides: for performers who never run or jump).
        floor_m: height of the floor in the world of the poses; None: it is below the lowest ball of the last seconds.

    Raises:
        SettingsError: there is no such mode.
    """

    def __init__(self, skeleton: Skeleton, mode: str, floor_m: float | None = 0.0) -> None:
        if mode not in FEET:
            raise SettingsError(f"there is no mode {mode!r} for the feet", advice="modes: " + ", ".join(FEET))
        self.mode = mode
        self._skeleton = skeleton
        self._floor_m = floor_m
        self._lowest: list[tuple[float, float]] = []
        self._feet = []
        for side, stand_m in zip("lr", _standing_heights(skeleton), strict=True):
            femur, tibia, foot, toes = (skeleton.index(side + name) for name in ("femur", "tibia", "foot", "toes"))
            self._feet.append(_Foot(femur, tibia, foot, toes, stand_m))
        self._time_s = -np.inf

    def step(self, time_s: float, rotations: Array, root_position_m: Array) -> Array:
        """Return the next pose's rotations (J, 4) with held feet; `time_s` ascends."""
        if self.mode == "off":
            return rotations
        passed_s = time_s - self._time_s
        self._time_s = time_s
        if not 0.0 < passed_s < _PAUSE_S:
            self._lowest.clear()
            for foot in self._feet:
                foot.forget()
        positions, world = forward_kinematics(self._skeleton, rotations, root_position_m)
        floor_m = self._floor_under(time_s, positions)
        heights = [float(positions[foot.toes, 1]) - floor_m - foot.stand_m for foot in self._feet]
        result = rotations
        carrying = self._carrying(heights) if self.mode == "always" else None
        for foot, height in zip(self._feet, heights, strict=True):
            glides = foot is carrying and height < _PLANTED_M
            self._hold(foot, time_s, passed_s, positions[foot.toes], height, glides)
            if np.dot(foot.offset_m, foot.offset_m) > 1e-10:
                result = result.copy() if result is rotations else result
                self._reach(foot, result, positions, world)
        return result

    def _floor_under(self, time_s: float, positions: Array) -> float:
        if self._floor_m is not None:
            return self._floor_m
        lowest = min(float(positions[foot.toes, 1]) - foot.stand_m for foot in self._feet)
        self._lowest = [(t, h) for t, h in self._lowest if time_s - t < 2.0]
        self._lowest.append((time_s, lowest))
        return min(height for _, height in self._lowest)

    def _carrying(self, heights: list[float]) -> _Foot:
        """Return the lower foot; a held one remains until the other is clearly lower."""
        bonus = [_LOWER_M if foot.anchor_m is not None else 0.0 for foot in self._feet]
        return self._feet[int(np.argmin(np.subtract(heights, bonus)))]

    def _hold(self, foot: _Foot, time_s: float, passed_s: float, ball: Array, height: float, glides: bool) -> None:
        """Plant or release a foot by its ball's motion, and set its offset."""
        foot.past = [(t, p) for t, p in foot.past if time_s - t <= _WINDOW_S + 1e-6]
        foot.past.append((time_s, ball))
        (since_s, before) = foot.past[0]
        speed = float(np.linalg.norm(ball - before)) / max(time_s - since_s, 1e-6) if len(foot.past) > 1 else np.inf
        if foot.anchor_m is None:
            if glides or (speed < _PLANTED_M_S and height < _PLANTED_M):
                foot.anchor_m = ball + foot.offset_m
        elif height > _LIFTED_M or (speed > _LIFTED_M_S and not glides):
            foot.anchor_m = None
        if foot.anchor_m is not None:
            wanted = foot.anchor_m - ball
            wanted[1] = 0.0
            if not glides:  # one that begins to leave is let go of little by little
                leaves = min(max((speed - _PLANTED_M_S) / (_LIFTED_M_S - _PLANTED_M_S), 0.0), 1.0)
                wanted *= np.exp(-leaves * passed_s / _FADE_S)
                wanted = _within(_LIFTED_M_S * passed_s, foot.offset_m, wanted)  # the window's speed lags behind
                foot.anchor_m = ball + wanted
            if np.linalg.norm(wanted) <= (_GLIDE_REACH_M if glides else _REACH_M):
                foot.offset_m = wanted
                return
            foot.anchor_m = None
        foot.offset_m = foot.offset_m * np.exp(-passed_s / _FADE_S)

    def _reach(self, foot: _Foot, rotations: Array, positions: Array, world: Array) -> None:
        """Turn hip, knee and ankle in `rotations`: the ankle moves by its offset."""
        hip, knee, ankle = positions[foot.femur], positions[foot.tibia], positions[foot.foot]
        femur, tibia = reach_with_two_bones(
            (hip, knee, ankle),
            (world[foot.femur], world[foot.tibia]),
            ankle - hip + foot.offset_m,
            rot.rotate(world[foot.tibia], _KNEE_AXIS),
            _STRETCH,
        )
        above = world[self._skeleton.parents[foot.femur]]
        rotations[foot.femur] = rot.multiply(rot.conjugate(above), femur)
        rotations[foot.tibia] = rot.multiply(rot.conjugate(femur), tibia)
        rotations[foot.foot] = rot.multiply(rot.conjugate(tibia), world[foot.foot])
