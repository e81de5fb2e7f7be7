"""Boxing: guard, footwork, punches, ducking and slipping, in combinations.

Everything is written for a boxer with the left foot in front; `lead` mirrors it. Lengths are shares of the arm's length
where they place hands, and metres for a leg of 0.85 m where they place feet.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .feet import Swing
from .fighter import LEAVE_S, SHORT_S, Fighter
from .proportions import outward
from .timeline import Timeline

_COMBINATIONS = (
    ("jab",), ("jab", "jab"), ("jab", "cross"), ("jab", "cross", "hook"), ("cross", "hook"), ("hook", "cross"),
    ("jab", "uppercut"), ("duck", "cross"), ("duck", "hook"), ("slip", "cross"), ("duck",), ("weave", "hook"),
    ("jab", "cross", "hook", "rear_hook"), ("uppercut", "hook"),
)  # fmt: skip
_REAR_HEEL_UP = 0.22

_Vector = tuple[float, float, float]


@dataclass(frozen=True)
class _Hand:
    """A fist: wrist, directions of fingers and palm for the left hand, the elbow's swivel, the collar bone's shrug."""

    target: _Vector
    fingers: _Vector
    palm: _Vector
    swivel: float
    shrug: tuple[float, float] = (0.04, 0.05)


@dataclass(frozen=True)
class _Trunk:
    """Trunk of a boxer: radians, metres of sinking, weight on the front foot."""

    yaw: float = -0.55
    twist: float = 0.0
    pitch: float = 0.10
    flex: float = 0.16
    side: float = 0.0
    sink: float = 0.045
    weight: float = 0.0


@dataclass(frozen=True)
class _Blow:
    """A blow with the front ("lead") or the other hand.

    Args:
        times: Seconds for wind-up, motion to the impact and return.
        reach: Distance of the impact in front, in arm lengths, if the style's amplitude changes it.
        pivot: Seconds after the start at which the foot begins to turn, its pitch, its turn.
    """

    hand: str
    times: _Vector
    hit: _Hand
    wind_up: _Trunk
    impact: _Trunk
    wind: _Hand | None = None
    reach: float | None = None
    pivot: _Vector | None = None


_LEAD_GUARD = _Hand((0.13, 0.10, 0.62), (-0.25, 0.72, 0.62), (-1.0, -0.1, 0.0), 0.15)
_REAR_GUARD = _Hand((0.10, 0.09, 0.38), (-0.15, 0.88, 0.45), (-1.0, 0.0, -0.1), 0.25)
_HOOK_FINGERS, _HOOK_PALM = (-0.95, 0.0, 0.30), (-0.35, -0.35, -1.0)
_BLOWS = {
    "jab": _Blow(
        "lead", (0.05, 0.15, 0.26), _Hand((-0.01, 0.13, 0.0), (0.0, 0.02, 1.0), (-0.15, -1.0, 0.0), 0.55, (0.10, 0.18)),
        _Trunk(yaw=-0.52, weight=-0.1), _Trunk(yaw=-0.72, twist=-0.22, flex=0.18, weight=0.25), reach=1.16,
    ),
    "cross": _Blow(
        "rear", (0.08, 0.17, 0.32), _Hand((-0.04, 0.11, 0.0), (0.0, 0.0, 1.0), (-0.2, -1.0, 0.0), 0.60, (0.10, 0.20)),
        _Trunk(yaw=-0.62, twist=-0.08, weight=-0.25),
        _Trunk(yaw=0.22, twist=0.32, pitch=0.14, flex=0.20, sink=0.065, weight=0.55),
        reach=1.15, pivot=(0.04, 0.55, 0.60),
    ),
    "hook": _Blow(
        "lead", (0.17, 0.15, 0.32), _Hand((-0.20, 0.13, 0.78), _HOOK_FINGERS, _HOOK_PALM, 1.45, (0.12, 0.12)),
        _Trunk(yaw=-0.28, twist=0.25, weight=0.35, sink=0.06, side=0.05),
        _Trunk(yaw=-0.72, twist=-0.10, weight=-0.15, sink=0.05),
        wind=_Hand((0.52, 0.02, 0.42), (-0.2, 0.35, 0.9), (-1.0, -0.2, 0.0), 1.15), pivot=(0.15, 0.40, 0.50),
    ),
    "rear_hook": _Blow(
        "rear", (0.17, 0.17, 0.34), _Hand((-0.08, 0.12, 0.76), _HOOK_FINGERS, _HOOK_PALM, 1.45, (0.12, 0.12)),
        _Trunk(yaw=-0.70, twist=-0.20, weight=-0.30, sink=0.06),
        _Trunk(yaw=0.25, twist=0.35, weight=0.50, sink=0.06),
        wind=_Hand((0.55, 0.0, 0.25), (-0.2, 0.35, 0.9), (-1.0, -0.2, 0.0), 1.15), pivot=(0.12, 0.60, 0.65),
    ),
    "uppercut": _Blow(
        "rear", (0.20, 0.17, 0.32),
        _Hand((-0.02, 0.16, 0.66), (-0.05, 1.0, 0.15), (0.1, 0.1, -1.0), 0.20, (0.12, 0.10)),
        _Trunk(yaw=-0.70, twist=-0.15, weight=-0.30, sink=0.12, flex=0.24, side=-0.12),
        _Trunk(yaw=0.10, twist=0.25, weight=0.35, sink=0.03, flex=0.06),
        wind=_Hand((0.16, -0.42, 0.42), (-0.1, 0.15, 1.0), (-0.3, 1.0, -0.1), 0.15), pivot=(0.15, 0.50, 0.45),
    ),
}  # fmt: skip


class _Boxer(Fighter):
    """Writes a boxer's keys to a timeline."""

    def __init__(self, timeline: Timeline, lead: str) -> None:
        super().__init__(timeline)
        self.lead, self.rear = lead, "r" if lead == "l" else "l"
        self.guards = {self.lead: _LEAD_GUARD, self.rear: _REAR_GUARD}

    # ---- postures

    def trunk(self, time_s: float, pose: _Trunk, looseness: float = 1.0) -> None:
        """Key the trunk, with small random differences."""
        timeline, m, j = self.timeline, outward(self.lead), self.timeline.jitter
        scatter = 0.03 * looseness
        flex = pose.flex + 0.5 * timeline.style.slouch_rad
        timeline.set(
            time_s,
            height=timeline.body.standing_m - (pose.sink + abs(j(0.006)) * looseness) * self.size,
            pelvis=(m * pose.yaw + j(scatter), pose.pitch + j(0.5 * scatter), 0.0),
            spine=(flex + j(0.7 * scatter), m * pose.side + j(0.6 * scatter), m * pose.twist),
            head=(j(0.04), 0.14 + j(0.02), -0.3 * m * pose.side),
            weight=m * pose.weight,
            heading=self.heading,
        )

    def fist(self, side: str, time_s: float, hand: _Hand, scatter: float = 0.03) -> None:
        """Key a fist described for the left hand on the side to which it belongs."""
        timeline, flip = self.timeline, np.array([outward(side), 1.0, 1.0])
        shift = np.array([timeline.jitter(scatter) for _ in range(3)])
        target = timeline.body.arm_m * (np.array(hand.target) * flip + shift)
        timeline.hand(side, time_s, target, np.array(hand.fingers) * flip, np.array(hand.palm) * flip)
        swivel = max(0.05, hand.swivel + timeline.jitter(0.08))
        timeline.set_side(side, time_s, swivel=swivel, shrug=hand.shrug, grip=0.95)

    def guard(self, time_s: float) -> float:
        """Key the guard: both fists up, knees soft, the body turned; return its time."""
        self.trunk(time_s, _Trunk())
        for side, hand in self.guards.items():
            self.fist(side, time_s, hand)
        self.foot(time_s, self.lead, 0.0, 0.0)
        self.foot(time_s, self.rear, _REAR_HEEL_UP, 0.0)
        return time_s

    def foot(self, time_s: float, side: str, heel_up: float, pivot: float) -> None:
        """Key a standing foot: heel height and inward pivot about the ball."""
        self.timeline.set_side(side, time_s, pitch=heel_up, pivot=-outward(side) * pivot, knee=0.10)

    # ---- feet

    def stand(self, lift_s: float, forward: float = 0.0, left: float = 0.0, first: str = "") -> float:
        """Step with both feet to the stance moved by (forward, left) metres; return when the second foot has landed."""
        timeline = self.timeline
        self.move_spot(forward, left, (-0.6, -0.8), (0.6, 0.9))
        first = first or (self.lead if forward >= 0.0 else self.rear)
        second = self.rear if first == self.lead else self.lead
        air = 0.17 / timeline.style.tempo
        time_s = max(lift_s, timeline.feet[first].free_s + 0.05, timeline.feet[second].free_s + 0.05)
        for side in (first, second):
            self._step(side, time_s, time_s + air)
            time_s += air + 0.05
        return time_s

    def _step(self, side: str, lift_s: float, land_s: float) -> None:
        timeline, front, m = self.timeline, side == self.lead, outward(self.lead)
        left_m = m * (0.10 if front else -0.13) * timeline.style.width * self.size
        yaw = m * (-0.20 if front else -0.75) + timeline.jitter(0.05)
        forward_m = ((0.20 if front else -0.22) + timeline.jitter(0.015)) * self.size
        spot = timeline.placed(side, self.spot, self.heading, left_m, forward_m, yaw)
        rest = 0.0 if front else _REAR_HEEL_UP
        swing = Swing(lift_s, land_s, spot, 0.030 * self.size)
        toe_up = 0.05 if front else -rest
        timeline.step(side, swing, heel_up_rad=max(0.18, rest), toe_up_rad=toe_up, rise_s=0.08, roll_s=0.06)
        timeline.set_side(side, land_s + 0.06, pitch=rest)


# ---- each returns the time at which the guard is reached again


def _strike(boxer: _Boxer, start_s: float, blow: _Blow) -> float:
    """Key one blow: wind-up, impact, return, each with its trunk pose."""
    timeline, hit = boxer.timeline, blow.hit
    side, other = (boxer.lead, boxer.rear) if blow.hand == "lead" else (boxer.rear, boxer.lead)
    if blow.reach is not None:
        hit = replace(hit, target=(*hit.target[:2], blow.reach * (0.9 + 0.1 * timeline.style.amplitude)))
    if blow is _BLOWS["jab"] and timeline.rng.random() < 0.35:
        boxer.stand(start_s, forward=0.10 if boxer.spot[1] < 0.5 else -0.06)
    pace = timeline.vary(1.0, 0.08) / timeline.style.tempo
    wind_s, hit_s, back_s = (start_s + pace * float(t) for t in np.cumsum(blow.times))
    cover = boxer.guards[other]
    timeline.anchor(start_s, *(f"{side}.{name}" for name in ("target", "palm", "swivel", "shrug")))
    if blow.wind is not None:
        boxer.fist(side, wind_s, blow.wind)
    boxer.fist(side, hit_s, hit, 0.035)
    boxer.fist(side, back_s, boxer.guards[side])
    tucked = _Hand((0.07, cover.target[1], cover.target[2] - 0.06), cover.fingers, cover.palm, 0.15)
    boxer.fist(other, hit_s, tucked, 0.015)
    boxer.fist(other, back_s, cover)
    boxer.trunk(wind_s, blow.wind_up)
    boxer.trunk(hit_s - 0.02, blow.impact)
    boxer.trunk(back_s, _Trunk())
    if blow.pivot is not None:
        _pivot(boxer, side, start_s, back_s, blow.pivot)
    return back_s


def _pivot(boxer: _Boxer, side: str, start_s: float, end_s: float, pivot: _Vector) -> None:
    """Turn a foot inwards on its ball during a blow and back."""
    delay_s, heel_up, turn = pivot
    timeline, start_s = boxer.timeline, start_s + delay_s
    if timeline.feet[side].free_s > start_s:
        return  # it is stepping
    timeline.anchor(start_s, f"{side}.pitch", f"{side}.pivot")
    boxer.foot(start_s + 0.5 * (end_s - start_s), side, timeline.vary(heel_up, 0.1), timeline.vary(turn, 0.1))
    boxer.foot(end_s + 0.05, side, 0.0 if side == boxer.lead else _REAR_HEEL_UP, 0.0)


def _duck(boxer: _Boxer, start_s: float) -> float:
    return _evade(boxer, start_s, _Trunk(pitch=0.38, flex=0.42, sink=0.21), (0.36, 0.08, 0.38))


def _slip(boxer: _Boxer, start_s: float) -> float:
    away = 1.0 if boxer.timeline.rng.random() < 0.5 else -1.0
    pose = _Trunk(yaw=-0.55 + 0.25 * away, twist=0.15 * away, side=0.30 * away, flex=0.24, sink=0.09, weight=0.4 * away)
    return _evade(boxer, start_s, pose, (0.26, 0.04, 0.28))


def _weave(boxer: _Boxer, start_s: float) -> float:
    timeline = boxer.timeline
    away = 1.0 if timeline.rng.random() < 0.5 else -1.0
    pace = timeline.vary(1.0, 0.08) / timeline.style.tempo
    low = _Trunk(pitch=0.34, flex=0.34)
    boxer.trunk(start_s + 0.30 * pace, replace(low, sink=0.13, side=0.22 * away, weight=0.5 * away))
    boxer.trunk(start_s + 0.54 * pace, replace(low, sink=0.20))
    boxer.trunk(start_s + 0.78 * pace, replace(low, sink=0.11, side=-0.22 * away, weight=-0.5 * away))
    return boxer.guard(start_s + 1.08 * pace)


def _evade(boxer: _Boxer, start_s: float, pose: _Trunk, times: _Vector) -> float:
    timeline = boxer.timeline
    down, hold, up = (timeline.vary(t, 0.08) / timeline.style.tempo for t in times)
    boxer.trunk(start_s + down, pose)
    for side, guard in boxer.guards.items():
        high = (guard.target[0], guard.target[1] + 0.08, guard.target[2] - 0.04)
        boxer.fist(side, start_s + down, _Hand(high, guard.fingers, guard.palm, 0.2), 0.02)
    if hold > 0.05:
        boxer.trunk(start_s + down + hold, pose, 0.5)
    return boxer.guard(start_s + down + hold + up)


_EVASIONS: dict[str, Callable[[_Boxer, float], float]] = {"duck": _duck, "slip": _slip, "weave": _weave}


# ---- the fight


def box(timeline: Timeline, seconds: float) -> None:
    """Take guard, move, strike combinations, lower the hands."""
    end = timeline.time_s + seconds
    boxer = _Boxer(timeline, "r" if timeline.rng.random() < 0.1 else "l")
    time_s, first = _take_guard(boxer), True
    while time_s < end - LEAVE_S - 0.4:
        if time_s > timeline.time_s + 1.5 or timeline.rng.random() < 0.6:
            time_s = _move(boxer, time_s)
        if time_s > end - LEAVE_S - 0.2:
            break
        combination = _COMBINATIONS[timeline.one_of(len(_COMBINATIONS))]
        if first and seconds < SHORT_S:
            combination = ("jab", "cross")
        first = False
        for action in combination:
            blow = _BLOWS.get(action)
            time_s = _strike(boxer, time_s, blow) if blow else _EVASIONS[action](boxer, time_s)
            time_s += max(0.0, timeline.jitter(0.03))
            if time_s > end - LEAVE_S:
                break
    _lower_guard(boxer, time_s)


def _take_guard(boxer: _Boxer) -> float:
    timeline, start = boxer.timeline, boxer.timeline.time_s
    timeline.anchor(start)
    ready = boxer.stand(start + 0.15) + 0.1
    for side, guard in boxer.guards.items():
        boxer.fist(side, start, guard)  # not visible while `guide` is 0
        timeline.set_side(side, start, grip=0.3)
        timeline.set_side(side, start + 0.55, guide=1.0)
    boxer.guard(ready)
    timeline.set(start + 0.55, height=timeline.body.standing_m - 0.03 * boxer.size)
    return ready


def _move(boxer: _Boxer, start_s: float) -> float:
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
    for side, guard in boxer.guards.items():
        boxer.fist(side, start_s + 0.5 * count * beat, guard)
        boxer.fist(side, time_s, guard)
    return max(time_s, timeline.feet["l"].free_s, timeline.feet["r"].free_s)


def _lower_guard(boxer: _Boxer, start_s: float) -> None:
    """Drop the hands and step back to stand square."""
    timeline = boxer.timeline
    timeline.anchor(start_s)
    boxer.feet_together(start_s, {boxer.rear: _REAR_HEEL_UP + 0.15, boxer.lead: 0.1 + 0.15}, 0.04, 0.2)
    timeline.set(start_s + 0.85, height=0.99 * timeline.body.standing_m)
    boxer.hang_arms(start_s + 0.95)
    timeline.stand(timeline.time_s)
