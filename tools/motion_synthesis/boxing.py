"""Boxing: guard, footwork, punches, ducking and slipping, in combinations.

All is written for a boxer with the left foot in front; `lead` mirrors it. Lengths are shares of the arm's length
where they place hands, metres for a leg of 0.85 m where they place feet.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .curves import Array
from .feet import Swing
from .proportions import outward
from .timeline import Timeline

_LEG_M = 0.85
_COMBINATIONS: tuple[tuple[str, ...], ...] = (
    ("jab",),
    ("jab", "jab"),
    ("jab", "cross"),
    ("jab", "cross", "hook"),
    ("cross", "hook"),
    ("hook", "cross"),
    ("jab", "uppercut"),
    ("duck", "cross"),
    ("duck", "hook"),
    ("slip", "cross"),
    ("duck",),
    ("weave", "hook"),
    ("jab", "cross", "hook", "rear_hook"),
    ("uppercut", "hook"),
)
_LEAVE_S = 1.4  # what lowering the guard takes
_SHORT_S = 6.0
_GUARD_YAW = 0.55  # the body's turn away from the front foot


@dataclass(frozen=True)
class _Hand:
    """A fist, with directions for the left hand.

    Target, directions of fingers and palm, elbow's swivel, collar bone, the arm's share.
    """

    target: tuple[float, float, float]
    fingers: tuple[float, float, float]
    palm: tuple[float, float, float]
    swivel: float
    shrug: tuple[float, float] = (0.04, 0.05)


_LEAD_GUARD = _Hand((0.13, 0.10, 0.62), (-0.25, 0.72, 0.62), (-1.0, -0.1, 0.0), 0.15)
_REAR_GUARD = _Hand((0.10, 0.09, 0.38), (-0.15, 0.88, 0.45), (-1.0, 0.0, -0.1), 0.25)


@dataclass(frozen=True)
class _Trunk:
    """Trunk of a boxer with the left foot in front.

    Radians, metres of sinking, weight on the front foot.
    """

    yaw: float = -_GUARD_YAW
    twist: float = 0.0
    pitch: float = 0.10
    flex: float = 0.16
    side: float = 0.0
    sink: float = 0.045
    weight: float = 0.0
    aside: float = 0.0


class Boxer:
    """Writes a boxer's keys into a timeline."""

    def __init__(self, timeline: Timeline, lead: str) -> None:
        self.timeline, self.lead = timeline, lead
        self.rear = "r" if lead == "l" else "l"
        self.mirror = outward(lead)
        self.size = timeline.body.leg_m / _LEG_M
        self.spot = timeline.spot
        self.heading = timeline.front_rad

    # ---- postures

    def trunk(self, time_s: float, pose: _Trunk, looseness: float = 1.0) -> None:
        """Key the trunk; small chance differences are added."""
        timeline, m, j = self.timeline, self.mirror, self.timeline.jitter
        slouch = timeline.style.slouch_rad
        scatter = 0.03 * looseness
        timeline.set(
            time_s,
            height=timeline.body.standing_m - (pose.sink + abs(j(0.006)) * looseness) * self.size,
            pelvis=(m * pose.yaw + j(scatter), pose.pitch + j(0.5 * scatter), 0.0),
            spine=(pose.flex + 0.5 * slouch + j(0.7 * scatter), m * pose.side + j(0.6 * scatter), m * pose.twist),
            head=(j(0.04), 0.14 + j(0.02), -0.3 * m * pose.side),
            weight=m * pose.weight,
            offset=(m * pose.aside * self.size, 0.0),
            heading=self.heading,
        )

    def fist(self, side: str, time_s: float, hand: _Hand, scatter: float = 0.03) -> None:
        """Key a fist given for the left hand on the side that it belongs to."""
        timeline, m = self.timeline, outward(side)
        arm = timeline.body.arm_m
        shift = np.array([timeline.jitter(scatter) for _ in range(3)])
        target = arm * (np.array(hand.target) * [m, 1.0, 1.0] + shift)
        timeline.hand(side, time_s, target, _flip(hand.fingers, m), _flip(hand.palm, m))
        values: dict[str, ArrayLike] = {
            f"{side}.swivel": max(0.05, hand.swivel + timeline.jitter(0.08)),
            f"{side}.shrug": hand.shrug,
            f"{side}.grip": 0.95,
        }
        timeline.set(time_s, **values)

    def guard(self, time_s: float, scatter: float = 0.03) -> None:
        """Key the guard: both fists up, knees soft, the body turned."""
        self.trunk(time_s, _Trunk())
        self.fist(self.lead, time_s, _LEAD_GUARD, scatter)
        self.fist(self.rear, time_s, _REAR_GUARD, scatter)
        self.foot(time_s, self.lead, 0.0, 0.0)
        self.foot(time_s, self.rear, 0.22, 0.0)

    def foot(self, time_s: float, side: str, heel_up: float, pivot: float) -> None:
        """Key a standing foot: heel height and inward pivot about the ball."""
        turn = -outward(side) * pivot
        self.timeline.set(time_s, **{f"{side}.pitch": heel_up, f"{side}.pivot": turn, f"{side}.knee": 0.10})

    # ---- feet

    def stand(self, lift_s: float, forward: float = 0.0, left: float = 0.0, first: str = "") -> float:
        """Step both feet into the stance moved by (forward, left) metres.

        Returns:
            time at which the second foot has landed.
        """
        timeline = self.timeline
        x, z = self.spot
        x += self.size * (left * np.cos(self.heading) + forward * np.sin(self.heading))
        z += self.size * (forward * np.cos(self.heading) - left * np.sin(self.heading))
        self.spot = (float(np.clip(x, -0.6, 0.6)), float(np.clip(z, -0.8, 0.9)))
        first = first or (self.lead if forward >= 0.0 else self.rear)
        second = self.rear if first == self.lead else self.lead
        air = 0.17 / timeline.style.tempo
        time_s = max(lift_s, timeline.feet[first].free_s + 0.05, timeline.feet[second].free_s + 0.05)
        for side in (first, second):
            self._step(side, time_s, time_s + air)
            time_s += air + 0.05
        return time_s

    def _step(self, side: str, lift_s: float, land_s: float) -> None:
        front = side == self.lead
        left = self.mirror * (0.10 if front else -0.13) * self.timeline.style.width
        yaw = self.mirror * (-0.20 if front else -0.75) + self.timeline.jitter(0.05)
        forward = 0.20 if front else -0.22
        spot = self.timeline.placed(
            side, self.spot, self.heading, left * self.size, (forward + self.timeline.jitter(0.015)) * self.size, yaw
        )
        rest = 0.0 if front else 0.22
        self.timeline.step(
            side, Swing(lift_s, land_s, spot, 0.030 * self.size), heel_up_rad=max(0.18, rest),
            toe_up_rad=0.05 if front else -rest, rise_s=0.08, roll_s=0.06,
        )  # fmt: skip
        self.timeline.set(land_s + 0.06, **{f"{side}.pitch": rest})


def _flip(vector: tuple[float, float, float], mirror: float) -> Array:
    return np.array(vector) * [mirror, 1.0, 1.0]


# ---- blows: each returns the time at which the guard is reached again


def _blow(
    boxer: Boxer, start_s: float, side: str, times: tuple[float, float, float], wind: _Hand | None, hit: _Hand,
    bodies: tuple[_Trunk, _Trunk],
) -> float:  # fmt: skip
    """Key one blow: wind-up, impact, return, each with its trunk pose."""
    timeline = boxer.timeline
    pace = timeline.vary(1.0, 0.08) / timeline.style.tempo
    wind_s, hit_s, back_s = (start_s + pace * t for t in np.cumsum(times))
    other = boxer.rear if side == boxer.lead else boxer.lead
    guard = _LEAD_GUARD if side == boxer.lead else _REAR_GUARD
    cover = _REAR_GUARD if side == boxer.lead else _LEAD_GUARD
    timeline.anchor(start_s, f"{side}.target", f"{side}.palm", f"{side}.swivel", f"{side}.shrug")
    if wind is not None:
        boxer.fist(side, wind_s, wind)
    boxer.fist(side, hit_s, hit, 0.035)
    boxer.fist(side, back_s, guard)
    tucked = _Hand((0.07, cover.target[1], cover.target[2] - 0.06), cover.fingers, cover.palm, 0.15)
    boxer.fist(other, hit_s, tucked, 0.015)
    boxer.fist(other, back_s, cover)
    boxer.trunk(wind_s, bodies[0])
    boxer.trunk(hit_s - 0.02, bodies[1])
    boxer.trunk(back_s, _Trunk())
    return float(back_s)


def _jab(boxer: Boxer, start_s: float) -> float:
    reach = 1.16 * (0.9 + 0.1 * boxer.timeline.style.amplitude)
    hit = _Hand((-0.01, 0.13, reach), (0.0, 0.02, 1.0), (-0.15, -1.0, 0.0), 0.55, (0.10, 0.18))
    if boxer.timeline.rng.random() < 0.35:
        boxer.stand(start_s, forward=0.10 if boxer.spot[1] < 0.5 else -0.06)
    bodies = (_Trunk(yaw=-0.52, weight=-0.1), _Trunk(yaw=-0.72, twist=-0.22, flex=0.18, weight=0.25))
    return _blow(boxer, start_s, boxer.lead, (0.05, 0.15, 0.26), None, hit, bodies)


def _cross(boxer: Boxer, start_s: float) -> float:
    reach = 1.15 * (0.9 + 0.1 * boxer.timeline.style.amplitude)
    hit = _Hand((-0.04, 0.11, reach), (0.0, 0.0, 1.0), (-0.2, -1.0, 0.0), 0.60, (0.10, 0.20))
    bodies = (
        _Trunk(yaw=-0.62, twist=-0.08, weight=-0.25),
        _Trunk(yaw=0.22, twist=0.32, pitch=0.14, flex=0.20, sink=0.065, weight=0.55),
    )
    end = _blow(boxer, start_s, boxer.rear, (0.08, 0.17, 0.32), None, hit, bodies)
    _pivot(boxer, boxer.rear, start_s + 0.04, end, 0.55, 0.60)
    return end


def _hook(boxer: Boxer, start_s: float) -> float:
    wind = _Hand((0.52, 0.02, 0.42), (-0.2, 0.35, 0.9), (-1.0, -0.2, 0.0), 1.15)
    hit = _Hand((-0.20, 0.13, 0.78), (-0.95, 0.0, 0.30), (-0.35, -0.35, -1.0), 1.45, (0.12, 0.12))
    bodies = (
        _Trunk(yaw=-0.28, twist=0.25, weight=0.35, sink=0.06, side=0.05),
        _Trunk(yaw=-0.72, twist=-0.10, weight=-0.15, sink=0.05),
    )
    end = _blow(boxer, start_s, boxer.lead, (0.17, 0.15, 0.32), wind, hit, bodies)
    _pivot(boxer, boxer.lead, start_s + 0.15, end, 0.40, 0.50)
    return end


def _rear_hook(boxer: Boxer, start_s: float) -> float:
    wind = _Hand((0.55, 0.0, 0.25), (-0.2, 0.35, 0.9), (-1.0, -0.2, 0.0), 1.15)
    hit = _Hand((-0.08, 0.12, 0.76), (-0.95, 0.0, 0.30), (-0.35, -0.35, -1.0), 1.45, (0.12, 0.12))
    bodies = (
        _Trunk(yaw=-0.70, twist=-0.20, weight=-0.30, sink=0.06),
        _Trunk(yaw=0.25, twist=0.35, weight=0.50, sink=0.06),
    )
    end = _blow(boxer, start_s, boxer.rear, (0.17, 0.17, 0.34), wind, hit, bodies)
    _pivot(boxer, boxer.rear, start_s + 0.12, end, 0.60, 0.65)
    return end


def _uppercut(boxer: Boxer, start_s: float) -> float:
    wind = _Hand((0.16, -0.42, 0.42), (-0.1, 0.15, 1.0), (-0.3, 1.0, -0.1), 0.15)
    hit = _Hand((-0.02, 0.16, 0.66), (-0.05, 1.0, 0.15), (0.1, 0.1, -1.0), 0.20, (0.12, 0.10))
    bodies = (
        _Trunk(yaw=-0.70, twist=-0.15, weight=-0.30, sink=0.12, flex=0.24, side=-0.12),
        _Trunk(yaw=0.10, twist=0.25, weight=0.35, sink=0.03, flex=0.06),
    )
    end = _blow(boxer, start_s, boxer.rear, (0.20, 0.17, 0.32), wind, hit, bodies)
    _pivot(boxer, boxer.rear, start_s + 0.15, end, 0.50, 0.45)
    return end


def _pivot(boxer: Boxer, side: str, start_s: float, end_s: float, heel_up: float, turn: float) -> None:
    """Turn a foot inwards on its ball with a blow and back."""
    rest = 0.0 if side == boxer.lead else 0.22
    if boxer.timeline.feet[side].free_s > start_s:
        return  # it is stepping
    timeline = boxer.timeline
    timeline.anchor(start_s, f"{side}.pitch", f"{side}.pivot")
    boxer.foot(start_s + 0.5 * (end_s - start_s), side, timeline.vary(heel_up, 0.1), timeline.vary(turn, 0.1))
    boxer.foot(end_s + 0.05, side, rest, 0.0)


# ---- evasions


def _duck(boxer: Boxer, start_s: float) -> float:
    return _evade(boxer, start_s, _Trunk(pitch=0.38, flex=0.42, sink=0.21), (0.36, 0.08, 0.38))


def _slip(boxer: Boxer, start_s: float) -> float:
    away = 1.0 if boxer.timeline.rng.random() < 0.5 else -1.0
    pose = _Trunk(yaw=-0.55 + 0.25 * away, twist=0.15 * away, side=0.30 * away, flex=0.24, sink=0.09, weight=0.4 * away)
    return _evade(boxer, start_s, pose, (0.26, 0.04, 0.28))


def _weave(boxer: Boxer, start_s: float) -> float:
    timeline = boxer.timeline
    away = 1.0 if timeline.rng.random() < 0.5 else -1.0
    pace = timeline.vary(1.0, 0.08) / timeline.style.tempo
    low = {"pitch": 0.34, "flex": 0.34}
    boxer.trunk(start_s + 0.30 * pace, _Trunk(sink=0.13, side=0.22 * away, weight=0.5 * away, **low))
    boxer.trunk(start_s + 0.54 * pace, _Trunk(sink=0.20, **low))
    boxer.trunk(start_s + 0.78 * pace, _Trunk(sink=0.11, side=-0.22 * away, weight=-0.5 * away, **low))
    end = start_s + 1.08 * pace
    boxer.guard(end)
    return end


def _evade(boxer: Boxer, start_s: float, pose: _Trunk, times: tuple[float, float, float]) -> float:
    timeline = boxer.timeline
    down, hold, up = (timeline.vary(t, 0.08) / timeline.style.tempo for t in times)
    boxer.trunk(start_s + down, pose)
    for side, guard in ((boxer.lead, _LEAD_GUARD), (boxer.rear, _REAR_GUARD)):
        high = _Hand((guard.target[0], guard.target[1] + 0.08, guard.target[2] - 0.04), guard.fingers, guard.palm, 0.2)
        boxer.fist(side, start_s + down, high, 0.02)
    if hold > 0.05:
        boxer.trunk(start_s + down + hold, pose, 0.5)
    end = start_s + down + hold + up
    boxer.guard(end)
    return end


_ACTIONS: dict[str, Callable[[Boxer, float], float]] = {
    "jab": _jab,
    "cross": _cross,
    "hook": _hook,
    "rear_hook": _rear_hook,
    "uppercut": _uppercut,
    "duck": _duck,
    "slip": _slip,
    "weave": _weave,
}


# ---- the fight


def box(timeline: Timeline, seconds: float) -> None:
    """Take guard, move, strike in combinations, lower the hands."""
    end = timeline.time_s + seconds
    boxer = Boxer(timeline, "r" if timeline.rng.random() < 0.1 else "l")
    time_s, first = _take_guard(boxer), True
    while time_s < end - _LEAVE_S - 0.4:
        if time_s > timeline.time_s + 1.5 or timeline.rng.random() < 0.6:
            time_s = _move(boxer, time_s)
        if time_s > end - _LEAVE_S - 0.2:
            break
        combination = _COMBINATIONS[int(timeline.rng.integers(len(_COMBINATIONS)))]
        if first and seconds < _SHORT_S:  # little time: show at least what boxing is
            combination = ("jab", "cross")
        first = False
        for action in combination:
            time_s = _ACTIONS[action](boxer, time_s) + max(0.0, timeline.jitter(0.03))
            if time_s > end - _LEAVE_S:
                break
    _lower_guard(boxer, time_s)


def _take_guard(boxer: Boxer) -> float:
    timeline = boxer.timeline
    start = timeline.time_s
    timeline.anchor(start)
    ready = boxer.stand(start + 0.15) + 0.1
    for side, guard in ((boxer.lead, _LEAD_GUARD), (boxer.rear, _REAR_GUARD)):
        boxer.fist(side, start, guard)  # not seen while `guide` is 0
        timeline.set(start, **{f"{side}.grip": 0.3})
        timeline.set(start + 0.55, **{f"{side}.guide": 1.0})
    boxer.guard(ready)
    timeline.set(start + 0.55, height=timeline.body.standing_m - 0.03 * boxer.size)
    return ready


def _move(boxer: Boxer, start_s: float) -> float:
    """Bounce in the guard and shuffle about."""
    timeline = boxer.timeline
    beat = timeline.vary(0.23, 0.06) / timeline.style.tempo
    count = int(timeline.rng.integers(2, 6))
    if timeline.rng.random() < 0.75:
        forward, left = timeline.jitter(0.13), timeline.jitter(0.10)
        if abs(boxer.spot[1]) > 0.45:
            forward = -0.15 * float(np.sign(boxer.spot[1]))
        first = "" if abs(forward) > abs(left) else ("l" if left > 0.0 else "r")
        boxer.stand(start_s + 0.05, forward, left, first)
    time_s = start_s
    for i in range(count):
        time_s = start_s + (i + 1) * beat
        low = 0.050 if i % 2 == 0 else 0.050 - 0.022 * timeline.style.bounce
        boxer.trunk(time_s, _Trunk(sink=low, weight=timeline.jitter(0.18), side=timeline.jitter(0.04)))
    for side, guard in ((boxer.lead, _LEAD_GUARD), (boxer.rear, _REAR_GUARD)):
        boxer.fist(side, start_s + 0.5 * count * beat, guard)
        boxer.fist(side, time_s, guard)
    return max(time_s, timeline.feet["l"].free_s, timeline.feet["r"].free_s)


def _lower_guard(boxer: Boxer, start_s: float) -> None:
    """Drop the hands and step back to stand square."""
    timeline = boxer.timeline
    timeline.anchor(start_s)
    lift = start_s + 0.25
    x, z = timeline.spot
    for side in (boxer.rear, boxer.lead):
        to = timeline.placement(side, x, z, boxer.heading)
        base = 0.22 if side == boxer.rear else 0.1
        timeline.step(side, Swing(lift, lift + 0.34, to, 0.04 * boxer.size), heel_up_rad=base + 0.15)
        lift += 0.42
    timeline.time_s = lift + 0.2
    timeline.set(start_s + 0.85, height=0.99 * timeline.body.standing_m)
    ease = timeline.at_ease()
    timeline.set(start_s + 0.95, **{k: v for k, v in ease.items() if ".pitch" not in k})
    timeline.set(timeline.time_s, height=timeline.body.standing_m * 0.997, **ease)
