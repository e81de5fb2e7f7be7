"""Kendo: middle guard, stamping cuts, practice swings, alternating cuts."""

from collections.abc import Callable

import numpy as np

from .feet import Swing
from .fighter import LEAVE_S, SHORT_S, Fighter
from .proportions import SIDES
from .timeline import Timeline

_HEEL_UP = 0.24  # the left heel stays off the ground
# left fist relative to the arm's length; blade up, left, edge turn
_Held = tuple[tuple[float, float, float], tuple[float, float, float]]
_CHUDAN: _Held = ((0.0, -0.62, 0.44), (0.42, 0.0, 0.0))
_RAISED: _Held = ((0.0, 0.36, 0.30), (2.30, 0.0, 0.0))
_HALF_RAISED: _Held = ((0.0, 0.10, 0.52), (1.55, 0.0, 0.0))
_MEN: _Held = ((0.0, -0.36, 0.52), (0.12, 0.0, 0.0))
_KOTE: _Held = ((0.0, -0.52, 0.52), (-0.05, -0.08, 0.0))
_DO: _Held = ((0.06, -0.52, 0.52), (-0.05, 0.40, -0.95))
_READY: _Held = ((0.0, -0.58, 0.36), (0.30, 0.0, 0.0))
_TSUKI: _Held = ((0.0, -0.34, 0.56), (0.10, 0.0, 0.0))


class _Kendoka(Fighter):
    """Writes a swordsman's keys to a timeline."""

    def sword(self, time_s: float, held: _Held, aside: float = 0.0, scatter: float = 1.0) -> None:
        """Key the sword; `aside` turns a cut to the left, together with the edge."""
        j = self.timeline.jitter
        fist = np.add(held[0], [j(0.012 * scatter), j(0.018 * scatter), j(0.015 * scatter)])
        aim = np.add(held[1], [j(0.04 * scatter), aside + j(0.025 * scatter), -0.8 * aside + j(0.02 * scatter)])
        self.timeline.set(time_s, sword=fist, aim=aim)

    def trunk(self, time_s: float, lean: float = 0.03, twist: float = 0.0, sink: float = 0.035) -> None:
        """Key an upright trunk."""
        timeline, j = self.timeline, self.timeline.jitter
        timeline.set(
            time_s,
            height=timeline.body.standing_m - (sink + abs(j(0.005))) * self.size,
            pelvis=(-0.06 + j(0.015), 0.5 * lean + 0.03, 0.0),
            spine=(0.5 * lean + 0.5 * timeline.style.slouch_rad + j(0.012), j(0.012), twist + j(0.015)),
            head=(j(0.02), 0.05 + 0.2 * lean + j(0.015), 0.0),
            heading=self.heading,
        )
        raised = timeline.value("sword")[1] > 0.2
        for side in SIDES:
            timeline.set_side(side, time_s, swivel=(0.75 if raised else 0.30) + j(0.04), grip=0.85)

    def guard(self, time_s: float) -> float:
        """Key the middle guard; return its time."""
        self.sword(time_s, _CHUDAN)
        self.trunk(time_s)
        return time_s

    def advance(
        self, lift_s: float, forward_m: float, left_m: float = 0.0, *, stamp: bool = False, quick: float = 1.0
    ) -> tuple[float, float]:
        """Slide forward right foot first, or backward left foot first; return when the first and second foot land."""
        feet = self.timeline.feet
        self.move_spot(forward_m, left_m, (-0.5, -0.95), (0.5, 1.0))
        first, second = ("r", "l") if forward_m >= 0.0 else ("l", "r")
        lift = max(lift_s, feet[first].free_s + 0.04)
        air = (0.24 if stamp else 0.22) / quick
        self._step(first, lift, lift + air, stamp)
        lift_2 = max(lift + 0.75 * air if stamp else lift + air - 0.02, feet[second].free_s + 0.04)
        if stamp:
            lift_2 = max(lift_2, lift + air + 0.02)
        self._step(second, lift_2, lift_2 + 0.9 * air, False)
        return lift + air, lift_2 + 0.9 * air

    def _step(self, side: str, lift_s: float, land_s: float, stamp: bool) -> None:
        timeline, right = self.timeline, side == "r"
        left_m = (-0.085 if right else 0.085) * timeline.style.width * self.size
        forward_m = ((0.16 if right else -0.19) + timeline.jitter(0.012)) * self.size
        yaw = 0.04 * (-1.0 if right else 1.0) + timeline.jitter(0.03)
        to = timeline.placed(side, self.spot, self.heading, left_m, forward_m, yaw)
        rest = 0.0 if right else _HEEL_UP
        timeline.step(
            side,
            Swing(lift_s, land_s, to, (0.075 if stamp else 0.018) * self.size, peak=0.55 if stamp else 0.5),
            heel_up_rad=0.12 if right else timeline.vary(0.55, 0.1),
            toe_up_rad=-rest,
            rise_s=0.10,
            roll_s=0.05,
        )
        timeline.set_side(side, land_s + 0.05, pitch=rest)


# ---- cuts: each returns the time at which it is finished


def _cut(k: _Kendoka, start_s: float, raised: _Held, hit: _Held, reach_m: float, *, recover: bool = True) -> float:
    """Raise the sword, cut with a stamping step, pause, return to the guard (if `recover`)."""
    timeline = k.timeline
    pace = timeline.vary(1.0, 0.07) / timeline.style.tempo
    up_s = start_s + (0.40 if raised is _RAISED else 0.24) * pace
    hit_s = up_s + 0.23 * pace
    timeline.anchor(start_s, "sword", "aim")
    k.sword(up_s, raised)
    k.trunk(up_s, 0.0)
    landed, closed = k.advance(hit_s - 0.25, timeline.vary(reach_m, 0.1), stamp=True)
    hit_s = max(hit_s, landed - 0.01)
    k.sword(hit_s, hit)
    k.trunk(hit_s, 0.14, -0.10 if hit is _DO else 0.0, 0.06)
    hold_s = max(hit_s + 0.14 * pace, closed)
    k.sword(hold_s, hit, 0.0, 0.5)
    k.trunk(hold_s, 0.08)
    return k.guard(hold_s + 0.32 * pace) if recover else hold_s


def _men(k: _Kendoka, start_s: float) -> float:
    return _cut(k, start_s, _RAISED if k.timeline.rng.random() < 0.7 else _HALF_RAISED, _MEN, 0.42)


def _kote(k: _Kendoka, start_s: float) -> float:
    return _cut(k, start_s, _HALF_RAISED, _KOTE, 0.30)


def _do(k: _Kendoka, start_s: float) -> float:
    return _cut(k, start_s, _RAISED, _DO, 0.36)


def _thrust(k: _Kendoka, start_s: float) -> float:
    return _cut(k, start_s, _READY, _TSUKI, 0.30)


def _kote_men(k: _Kendoka, start_s: float) -> float:
    middle = _cut(k, start_s, _HALF_RAISED, _KOTE, 0.22, recover=False)
    return _cut(k, middle, _HALF_RAISED, _MEN, 0.28)


def _practice_swings(k: _Kendoka, start_s: float) -> float:
    """Swing fully with steps forward and backward in turn."""
    timeline, time_s = k.timeline, start_s
    timeline.anchor(start_s, "sword", "aim")
    for i in range(int(timeline.rng.integers(3, 6))):
        pace = timeline.vary(1.0, 0.06) / timeline.style.tempo
        up_s, hit_s = time_s + 0.52 * pace, time_s + 0.80 * pace
        k.sword(up_s, _RAISED)
        k.trunk(up_s, -0.02, 0.0, 0.03)
        k.advance(hit_s - 0.30 * pace, 0.28 if i % 2 == 0 else -0.28, quick=0.85)
        k.sword(hit_s, _MEN)
        k.trunk(hit_s, 0.08, 0.0, 0.055)
        time_s = hit_s + 0.16 * pace
        k.sword(time_s, _MEN, 0.0, 0.4)
        k.trunk(time_s, 0.06)
    return k.guard(time_s + 0.4)


def _alternating(k: _Kendoka, start_s: float) -> float:
    """Cut the head's left and right alternately, with sliding steps forward, then back."""
    timeline, time_s = k.timeline, start_s
    timeline.anchor(start_s, "sword", "aim")
    count = 2 * int(timeline.rng.integers(2, 4))
    for i in range(count):
        pace = timeline.vary(0.9, 0.06) / timeline.style.tempo
        aside = (0.32 if i % 2 == 0 else -0.32) * timeline.vary(1.0, 0.1)
        up_s, hit_s = time_s + 0.36 * pace, time_s + 0.58 * pace
        k.sword(up_s, _RAISED, -0.5 * aside)
        k.trunk(up_s, 0.0)
        k.advance(hit_s - 0.26 * pace, 0.22 if i < count // 2 else -0.22)
        k.sword(hit_s, _MEN, aside)
        k.trunk(hit_s, 0.07, 0.25 * aside, 0.05)
        time_s = hit_s + 0.06
    return k.guard(time_s + 0.42)


_ACTIONS: tuple[Callable[[_Kendoka, float], float], ...] = (
    _men, _men, _kote, _do, _thrust, _kote_men, _practice_swings, _alternating,
)  # fmt: skip


# ---- the bout


def fence(timeline: Timeline, seconds: float) -> None:
    """Take the middle guard, step about, cut, put the sword away."""
    last_s = timeline.time_s + seconds
    end = last_s - LEAVE_S - 0.6
    k = _Kendoka(timeline)
    time_s, first = _take_guard(k), True
    while time_s < end:
        if time_s > timeline.time_s + 1.5 or timeline.rng.random() < 0.5:
            time_s = _wait(k, time_s)
        if time_s > end:
            break
        choices = _ACTIONS if last_s - time_s > 5.0 else _ACTIONS[:5]
        if first and seconds < SHORT_S:
            choices = (_men,)
        first = False
        time_s = choices[timeline.one_of(len(choices))](k, time_s)
    _put_away(k, time_s)


def _take_guard(k: _Kendoka) -> float:
    timeline, start = k.timeline, k.timeline.time_s
    timeline.anchor(start)
    for time_s in (start, start + 0.3):
        timeline.set(time_s, sword=(0.0, -0.70, 0.36), aim=(-0.1, 0.0, 0.0))
    timeline.set(start, holds=0.0)
    timeline.set(start + 1e-3, holds=1.0)
    _, landed = k.advance(start + 0.25, 0.0, quick=0.7)
    for side in SIDES:
        timeline.set_side(side, start + 0.75, guide=1.0)
    timeline.set(start + 0.6, height=timeline.body.standing_m - 0.02 * k.size)
    return k.guard(max(landed, start + 1.1))


def _wait(k: _Kendoka, start_s: float) -> float:
    """Hold the guard with a slightly moving point and sliding steps."""
    timeline, time_s = k.timeline, start_s
    for _ in range(int(timeline.rng.integers(1, 4))):
        forward = timeline.jitter(0.16)
        if 0.85 - k.spot[1] < 0.55:
            forward = -abs(timeline.vary(0.30, 0.2))
        elif k.spot[1] < -0.55:
            forward = abs(timeline.vary(0.25, 0.2))
        _, landed = k.advance(time_s + 0.04, forward, timeline.jitter(0.06))
        time_s = max(landed, time_s + 0.3) + 0.02
        k.sword(time_s, _CHUDAN, 0.0, 1.6)
        k.trunk(time_s, 0.03 + timeline.jitter(0.02))
    return time_s


def _put_away(k: _Kendoka, start_s: float) -> None:
    """Lower the sword and bring the feet together."""
    timeline = k.timeline
    timeline.anchor(start_s)
    timeline.set(start_s + 0.55, sword=(0.0, -0.68, 0.36), aim=(-0.15, 0.0, 0.0))
    k.feet_together(start_s, {"l": _HEEL_UP + 0.25, "r": 0.25}, 0.03, 0.25)
    for side in SIDES:
        timeline.set_side(side, start_s + 0.25, guide=1.0)
    timeline.set(start_s + 1.05, height=timeline.standing_m)
    k.hang_arms(start_s + 1.05)
    timeline.stand(timeline.time_s)
    timeline.set(timeline.time_s - 2e-3, holds=1.0)
    timeline.set(timeline.time_s, holds=0.0)
