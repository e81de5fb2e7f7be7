"""Foot lock: detects standing feet frame by frame, and holds them by bending the legs (see `moved_feet`).

The lock holds the ball of the foot (the toe joint), because the heel lifts long before the foot leaves the floor. The
ankle moves by the offset from the solved to the held ball. After the release the offset fades out, so that nothing
jumps.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import SettingsError
from ..geometry.arrays import Array
from ..geometry.camera import CameraRig
from .clock import PAUSE_S
from .motion import Motion
from .moved_feet import bent_legs, floor_height_m
from .skeleton import Skeleton, forward_kinematics
from .standing_feet import STANDING, standing_balls_m, stands

FEET = ("off", "auto", "always")


@dataclass(frozen=True)
class FootLockSettings:
    """Limits for held feet, beside those of standing ones (`standing_feet`)."""

    reach_m: float = 0.05  # largest offset of a held foot; a larger one shows that the foot really moved
    glide_reach_m: float = 0.30  # largest offset of a foot that is held although it glides
    lower_m: float = 0.02  # height by which a foot must be lower than the held one to replace it
    fade_s: float = 0.12  # time constant of the release
    still_m: float = 1e-5  # smaller offsets are left out
    floor_memory_s: float = 2.0  # period whose lowest ball of a foot shows the height of an unknown floor


_SETTINGS = FootLockSettings()


def floor_of(rig: CameraRig | None) -> float | None:
    """Return the floor's height in a calibration's world, or None if unknown."""
    return 0.0 if rig is not None and rig.metadata.get("floor") else None


def hold_feet(motion: Motion, mode: str, floor_m: float | None) -> Motion:
    """Return a motion with planted feet held in place; arguments and errors are those of `FootLock`.

    The height of an unknown floor is estimated from the lower foot of each frame.
    """
    if mode == "off":
        return motion
    lock = FootLock(motion.skeleton, mode, floor_height_m(motion) if floor_m is None else floor_m)
    frames = zip(motion.rotations, motion.root_positions_m, strict=True)
    held = [lock.step(i / motion.fps, rotations, root) for i, (rotations, root) in enumerate(frames)]
    return replace(motion, rotations=np.array(held))


def _within(reach_m: float, start: Array, end: Array) -> Array:
    """Return the end (3,), or the point towards it at distance `reach_m`."""
    way = end - start
    away_m = float(np.linalg.norm(way))
    return end if away_m <= reach_m else start + way * (reach_m / away_m)


@dataclass
class _Foot:
    """Ball of one foot, and the state of its lock."""

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
        mode: "off"; "auto": a low, slow foot is held until it lifts or moves away; "always": the lower foot is held
            even if it glides, for performers who never run or jump.
        floor_m: Height of the floor in the world of the poses; None to estimate it from the lowest ball of a foot in
            the last seconds.

    Raises:
        SettingsError: The mode is unknown.
    """

    def __init__(self, skeleton: Skeleton, mode: str, floor_m: float | None = 0.0) -> None:
        if mode not in FEET:
            raise SettingsError(f"{mode!r} is not a mode of the foot lock", advice="choose one of " + ", ".join(FEET))
        self.mode = mode
        self._skeleton = skeleton
        self._floor_m = floor_m
        self._lowest: list[tuple[float, float]] = []
        self._feet = []
        for side, stand_m in zip("lr", standing_balls_m(skeleton), strict=True):
            self._feet.append(_Foot(skeleton.index(side + "toes"), stand_m))
        self._time_s = -np.inf

    def step(self, time_s: float, rotations: Array, root_position_m: Array) -> Array:
        """Return the next pose's rotations (J, 4) with planted feet held; `time_s` must increase from call to call."""
        if self.mode == "off":
            return rotations
        passed_s = time_s - self._time_s
        self._time_s = time_s
        if not 0.0 < passed_s < PAUSE_S:
            self._lowest.clear()
            for foot in self._feet:
                foot.forget()
        positions, world = forward_kinematics(self._skeleton, rotations, root_position_m)
        floor_m = self._floor_under(time_s, positions)
        heights = [float(positions[foot.toes, 1]) - floor_m - foot.stand_m for foot in self._feet]
        carrying = self._carrying(heights) if self.mode == "always" else None
        for foot, height in zip(self._feet, heights, strict=True):
            glides = foot is carrying and height < STANDING.planted_m
            self._hold(foot, time_s, passed_s, positions[foot.toes], height, glides)
        offsets_m = np.array([foot.offset_m for foot in self._feet])
        if not np.any(np.abs(offsets_m) > _SETTINGS.still_m):
            return rotations
        bent, _ = bent_legs(self._skeleton, rotations[None], positions[None], world[None], offsets_m[None])
        return np.asarray(bent[0])

    def _floor_under(self, time_s: float, positions: Array) -> float:
        if self._floor_m is not None:
            return self._floor_m
        lowest = min(float(positions[foot.toes, 1]) - foot.stand_m for foot in self._feet)
        self._lowest = [(t, h) for t, h in self._lowest if time_s - t < _SETTINGS.floor_memory_s]
        self._lowest.append((time_s, lowest))
        return min(height for _, height in self._lowest)

    def _carrying(self, heights: list[float]) -> _Foot:
        """Return the lower foot, or the held one until the other is clearly lower."""
        bonus = [_SETTINGS.lower_m if foot.anchor_m is not None else 0.0 for foot in self._feet]
        return self._feet[int(np.argmin(np.subtract(heights, bonus)))]

    def _hold(self, foot: _Foot, time_s: float, passed_s: float, ball: Array, height: float, glides: bool) -> None:
        """Plant or release a foot according to its ball's motion, and set its offset."""
        foot.past = [(t, p) for t, p in foot.past if time_s - t <= STANDING.speed_window_s + 1e-6]
        foot.past.append((time_s, ball))
        (since_s, before) = foot.past[0]
        speed = float(np.linalg.norm(ball - before)) / max(time_s - since_s, 1e-6) if len(foot.past) > 1 else np.inf
        held = stands(foot.anchor_m is not None, height, 0.0 if glides else speed)
        if not held:
            foot.anchor_m = None
        elif foot.anchor_m is None:
            foot.anchor_m = ball + foot.offset_m
        if foot.anchor_m is not None:
            wanted = foot.anchor_m - ball
            wanted[1] = 0.0
            if not glides:  # a foot that begins to lift is released gradually
                slow, fast = STANDING.planted_m_s, STANDING.lifted_m_s
                leaves = min(max((speed - slow) / (fast - slow), 0.0), 1.0)
                wanted *= np.exp(-leaves * passed_s / _SETTINGS.fade_s)
                # the measured speed lags, so a quick lift-off is noticed late; until then the offset may grow only
                # slowly
                wanted = _within(STANDING.lifted_m_s * passed_s, foot.offset_m, wanted)
                foot.anchor_m = ball + wanted
            if np.linalg.norm(wanted) <= (_SETTINGS.glide_reach_m if glides else _SETTINGS.reach_m):
                foot.offset_m = wanted
                return
            foot.anchor_m = None
        foot.offset_m = foot.offset_m * np.exp(-passed_s / _SETTINGS.fade_s)
