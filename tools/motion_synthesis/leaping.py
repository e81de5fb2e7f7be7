"""Hopping on both feet or one; jumping high, forward, to the side, and with a turn."""

import numpy as np

from .feet import HELD_S, Placement, Swing
from .gait import fly_high
from .proportions import GRAVITY_M_S2, SIDES, facing_front, outward
from .timeline import Timeline

_OFF_TOES, _ON_TOES = 1.030, 1.010  # root height at take-off (legs straight, heels up) and landing, share of standing


def hop(timeline: Timeline, seconds: float) -> None:
    """Hop lightly: on both feet, on one, changing feet."""
    end = timeline.time_s + seconds
    while end - timeline.time_s > 2.2:
        left_s = end - timeline.time_s
        count = int(timeline.rng.integers(4, 8))
        if timeline.rng.random() < 0.45 and left_s > 4.0:
            _hops_on_one(timeline, SIDES[timeline.one_of(2)], count)
        else:
            _hops_on_both(timeline, count)


def jump(timeline: Timeline, seconds: float) -> None:
    """Jump with a countermovement and swinging arms: high, forward and back, sideways, with a quarter turn."""
    end = timeline.time_s + seconds
    while end - timeline.time_s > 1.7:
        kinds = ["high", "high", "forward" if timeline.spot[1] < 0.3 else "back", "side", "turn", "tuck", "star"]
        _jump_once(timeline, kinds[timeline.one_of(len(kinds))])


# ---- hopping


def _hops_on_both(timeline: Timeline, count: int) -> None:
    style, standing = timeline.style, timeline.body.standing_m
    timeline.anchor(timeline.time_s)
    rise = 0.075 * style.amplitude * style.bounce
    lift_s = timeline.time_s + 0.45 / style.tempo
    timeline.set(lift_s - 0.24, height=0.93 * standing)
    _hop_posture(timeline, lift_s - 0.24, 0.10)
    for i in range(count):
        high = timeline.vary(rise, 0.15) * (0.75 if i == 0 else 1.0)
        land_s = _fly(timeline, lift_s, high)
        for side in SIDES:
            _leap(timeline, side, (lift_s, land_s), _drifted(timeline, side, i == count - 1), high, 0.35)
        _hop_posture(timeline, 0.5 * (lift_s + land_s), -0.04)
        ground_s = timeline.vary(0.24, 0.06) / style.tempo
        _hop_posture(timeline, land_s + 0.5 * ground_s, 0.10)
        lift_s = land_s + ground_s
    _recover(timeline, land_s, 0.93, 0.65)


def _hops_on_one(timeline: Timeline, side: str, count: int) -> None:
    """Raise the other foot, hop, and set it down again."""
    start, style = timeline.time_s, timeline.style
    timeline.anchor(start)
    other, lean = ("r" if side == "l" else "l"), outward(side)
    lift_s = start + HELD_S + 0.55 / style.tempo
    high = 0.055 * style.amplitude * style.bounce
    timeline.set(lift_s - 0.26, height=0.945 * timeline.body.standing_m)
    _hop_posture(timeline, lift_s - 0.26, 0.12, lean * 0.06)
    for i in range(count):
        rise = timeline.vary(high, 0.12)
        land_s = _fly(timeline, lift_s, rise)
        _leap(timeline, side, (lift_s, land_s), _drifted(timeline, side, i == count - 1), rise, 0.30)
        # the raised foot moves up and down with the body
        middle_s = 0.5 * (lift_s + land_s)
        timeline.set_side(other, lift_s - 0.12, lift=-0.3 * rise, pitch=0.75)
        timeline.set_side(other, middle_s, lift=0.9 * rise, pitch=0.60 + timeline.jitter(0.05))
        timeline.set_side(other, land_s + 0.12, lift=-0.3 * rise, pitch=0.75)
        _hop_posture(timeline, middle_s, 0.0, lean * 0.05)
        ground_s = timeline.vary(0.27, 0.05) / style.tempo
        _hop_posture(timeline, land_s + 0.5 * ground_s, 0.12, lean * 0.07)
        lift_s = land_s + ground_s
    at = timeline.feet[side].current
    there = timeline.placement(side, 0.0, 0.0, timeline.heading_rad)
    back = timeline.placement(other, at.x_m - there.x_m, at.z_m - there.z_m, timeline.heading_rad)
    swing = Swing(start + 0.3, land_s + 0.55, back, 0.20 * timeline.body.leg_m, held=True)
    timeline.step(other, swing, heel_up_rad=0.55, toe_up_rad=-0.10)
    timeline.set_side(other, land_s + 0.15, lift=0.0, pitch=0.65)
    _recover(timeline, land_s, 0.945, 0.75)


def _fly(timeline: Timeline, lift_s: float, rise_m: float) -> float:
    """Key a flight in which the root rises by `rise_m`; return the time of landing."""
    standing = timeline.body.standing_m
    drop = rise_m + (_OFF_TOES - _ON_TOES) * standing
    land_s = lift_s + float(np.sqrt(2.0 * rise_m / GRAVITY_M_S2) + np.sqrt(2.0 * drop / GRAVITY_M_S2))
    fly_high(timeline, lift_s, _OFF_TOES * standing, land_s, _ON_TOES * standing)
    return land_s


def _drifted(timeline: Timeline, side: str, last: bool) -> Placement:
    at, j = timeline.feet[side].current, timeline.jitter
    return at if last else Placement(at.x_m + j(0.012), at.z_m + j(0.012), at.yaw_rad + j(0.02))


def _leap(
    timeline: Timeline,
    side: str,
    air_s: tuple[float, float],
    to: Placement,
    rise_m: float,
    land_up_rad: float,
    fold_m: float = 0.0,
) -> None:
    """Lift a foot over its ball and set it down on it, with the body's flight."""
    j = timeline.jitter
    uneven = 0.005 + 0.08 * timeline.style.asymmetry  # no one leaves the ground with both feet at exactly the same time
    lift_s, land_s = air_s[0] - abs(j(uneven)), air_s[1] + abs(j(uneven))
    spot = Placement(to.x_m + j(0.01), to.z_m + j(0.015), to.yaw_rad + j(0.03))
    swing = Swing(lift_s, land_s, spot, rise_m + 0.02 + fold_m, power=1.6)
    heel_up, toe_up = timeline.vary(0.80, 0.05), -timeline.vary(land_up_rad, 0.1)
    timeline.step(side, swing, heel_up_rad=heel_up, toe_up_rad=toe_up, rise_s=0.13, roll_s=0.10)


def _hop_posture(timeline: Timeline, time_s: float, give: float, lean: float = 0.0) -> None:
    """Key trunk and arms during a hop.

    Args:
        give: Positive when the body sinks.
        lean: Bend of the trunk to the left.
    """
    style, j = timeline.style, timeline.jitter
    timeline.set(
        time_s,
        pelvis=(j(0.03), 0.06 + 0.8 * give, 0.4 * lean),
        spine=(0.04 + style.slouch_rad + give, lean + j(0.01), j(0.04)),
        head=(j(0.04), 0.05 + style.head_drop_rad - 0.2 * give, 0.0),
    )
    for side in SIDES:
        swing = 0.10 + (-1.6 * give + j(0.05)) * style.arm_swing
        out = 0.30 + (-0.8 * give + abs(j(0.05))) * style.arm_swing + 3.0 * abs(lean) * 0.8
        timeline.set_side(
            side,
            time_s,
            arm=(swing, out, 0.15),
            elbow=0.95 - 1.2 * give + j(0.06),
            grip=0.35,
            hand=(j(0.05), 0.05 - 0.8 * give, 0.0),
            shrug=(0.02 - 0.3 * give, 0.0),
        )


def _recover(timeline: Timeline, land_s: float, low: float, rise_s: float) -> None:
    """Bend the knees after the last landing and stand up."""
    timeline.set(land_s + 0.16, height=low * timeline.body.standing_m)
    rest_s = land_s + 0.16 + rise_s / timeline.style.tempo
    timeline.stand(rest_s)
    timeline.time_s = rest_s + 0.1


# ---- jumping


def _jump_once(timeline: Timeline, kind: str) -> None:
    style, standing = timeline.style, timeline.body.standing_m
    timeline.anchor(timeline.time_s)
    rise = max(0.10, timeline.vary(0.26, 0.18) * style.amplitude * (0.6 if kind in ("side", "star") else 1.0))
    low = standing - (0.20 + 0.30 * rise) * standing * timeline.vary(1.0, 0.08)
    speed = float(np.sqrt(2.0 * GRAVITY_M_S2 * rise))
    sunk_s = timeline.time_s + timeline.vary(0.52, 0.08) / style.tempo
    lift_s = sunk_s + 2.0 * (_OFF_TOES * standing - low) / speed
    timeline.set(sunk_s, height=low)
    land_s = _fly(timeline, lift_s, rise)
    _jump_feet(timeline, kind, lift_s, land_s, rise)
    caught_s = land_s + timeline.vary(0.20, 0.1)
    timeline.set(caught_s, height=standing * (0.86 - 0.25 * rise) * timeline.vary(1.0, 0.02))
    _jump_trunk(timeline, kind, (sunk_s, lift_s, land_s, caught_s))
    _jump_arms(timeline, kind, (sunk_s, lift_s, land_s, caught_s))
    rest_s = caught_s + timeline.vary(0.55, 0.1) / style.tempo
    rest_s = max(rest_s, max(timeline.feet[side].free_s for side in SIDES) + 0.12)
    timeline.stand(rest_s)
    timeline.time_s = rest_s + max(0.05, timeline.vary(0.2, 0.4))


def _jump_feet(timeline: Timeline, kind: str, lift_s: float, land_s: float, rise_m: float) -> None:
    """Move both feet through the air and turn on the way."""
    x, z = timeline.spot
    front = facing_front(timeline.heading_rad)
    heading = front + timeline.jitter(0.04)
    way = timeline.style.amplitude * timeline.vary(0.40, 0.15)
    if kind in ("forward", "back"):
        z += way if kind == "forward" else -0.7 * way
    elif kind == "side":
        x += -0.7 * way * float(np.sign(x if abs(x) > 0.05 else timeline.jitter(1.0) + 1e-3))
    elif kind == "turn":
        away = abs(timeline.heading_rad - front) > 0.5
        heading = front if away else front + float(timeline.rng.choice([-1.0, 1.0])) * timeline.vary(1.3, 0.08)
    fold = 0.16 * timeline.body.leg_m / 0.85 if kind == "tuck" else 0.0
    for side in SIDES:
        to = timeline.placement(side, x, z, heading, 2.6 if kind == "star" else 1.1)
        _leap(timeline, side, (lift_s, land_s), to, rise_m, 0.45, fold)
    if kind == "star":  # step back from the straddle, one foot after the other
        x, z = timeline.spot
        for begin, side in ((land_s + 0.45, "l"), (land_s + 0.45 + 0.36, "r")):
            swing = Swing(begin, begin + 0.30, timeline.placement(side, x, z, heading), 0.05)
            timeline.step(side, swing, heel_up_rad=0.4)
    timeline.anchor(lift_s - 0.08, "heading")
    timeline.set(land_s, heading=heading)


def _jump_trunk(timeline: Timeline, kind: str, times_s: tuple[float, float, float, float]) -> None:
    sunk_s, lift_s, land_s, caught_s = times_s
    slouch, drop = timeline.style.slouch_rad, timeline.style.head_drop_rad
    lean = {"forward": 0.12, "back": -0.08}.get(kind, 0.0)
    pitches = {sunk_s: (0.50 + lean, 0.42), lift_s: (0.06 + lean, -0.02), caught_s: (0.34 - lean, 0.30)}
    pitches[0.5 * (lift_s + land_s)] = (0.30, 0.25) if kind == "tuck" else (0.02, 0.02)
    for time_s, (pelvis, spine) in pitches.items():
        aside = timeline.jitter(0.015)
        timeline.set(
            time_s,
            pelvis=(timeline.jitter(0.02), pelvis * timeline.vary(1.0, 0.08), 0.0),
            spine=(spine * timeline.vary(1.0, 0.1) + slouch, aside, timeline.jitter(0.03)),
            head=(timeline.jitter(0.03), 0.4 * pelvis + drop, 0.0),
        )


def _jump_arms(timeline: Timeline, kind: str, times_s: tuple[float, float, float, float]) -> None:
    sunk_s, lift_s, land_s, caught_s = times_s
    reach = timeline.style.arm_swing * timeline.vary(1.0, 0.1)
    up = {"high": 2.45, "tuck": 1.4, "star": 0.5, "forward": 1.9}.get(kind, 1.6) * (0.6 + 0.4 * reach)
    out = {"star": 2.0, "turn": 0.6, "side": 0.7}.get(kind, 0.35)
    for side in SIDES:
        share = 1.0 + timeline.style.asymmetry * outward(side)
        keys = {
            sunk_s: (-0.60 * reach * share, 0.35, -0.1, 0.60),
            lift_s - 0.02: (0.70 * up * share, 0.35 + 0.4 * (out - 0.35), 0.1, 0.95),
            0.5 * (lift_s + land_s): (up * share, out, 0.0, 0.70),
            land_s + 0.02: (0.45 * up, 0.45 + 0.25 * (out - 0.35), 0.1, 0.95),
            caught_s + 0.05: (0.40 + timeline.jitter(0.15), 0.45, 0.2, 1.00),
        }
        for time_s, (flex, abduct, twist, bend) in keys.items():
            timeline.set_side(
                side,
                time_s,
                arm=(flex, abduct + timeline.jitter(0.03), twist),
                elbow=bend * timeline.vary(1.0, 0.1),
                grip=0.30,
                hand=(0.05 + timeline.jitter(0.05), 0.05, 0.0),
            )
