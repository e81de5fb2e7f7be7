"""Hopping on both feet or one; jumping high, forward, to the side, with a turn."""

import numpy as np
from numpy.typing import ArrayLike

from .feet import HELD_S, Placement, Swing
from .gait import fly_high
from .proportions import GRAVITY_M_S2, SIDES, outward, turned
from .timeline import STANDING_HEIGHT, Score

_OFF_TOES = 1.030  # root height at take-off, share of standing on flat feet: legs straight, heels up
_ON_TOES = 1.010


def hop(score: Score, seconds: float) -> None:
    """Hop lightly: on both feet, on one, changing."""
    end = score.time_s + seconds
    while end - score.time_s > 2.2:
        left_s = end - score.time_s
        count = int(score.rng.integers(4, 8))
        if score.rng.random() < 0.45 and left_s > 4.0:
            _hops_on_one(score, SIDES[int(score.rng.integers(2))], count)
        else:
            _hops_on_both(score, count)


def jump(score: Score, seconds: float) -> None:
    """Jump with a countermovement and swinging arms.

    High, forward and back, sideways, with a quarter turn.
    """
    end = score.time_s + seconds
    while end - score.time_s > 1.7:
        _, z = score.spot
        kinds = ["high", "high", "forward" if z < 0.3 else "back", "side", "turn", "tuck", "star"]
        _jump_once(score, kinds[int(score.rng.integers(len(kinds)))])


# ---- hopping


def _hops_on_both(score: Score, count: int) -> None:
    start, style = score.time_s, score.style
    score.anchor(start)
    standing = score.body.standing_m
    rise = 0.075 * style.amplitude * style.bounce
    lift_s = start + 0.45 / style.tempo
    score.set(lift_s - 0.24, height=0.93 * standing)
    _hop_posture(score, lift_s - 0.24, 0.10)
    for i in range(count):
        high = score.vary(rise, 0.15) * (0.75 if i == 0 else 1.0)
        land_s = lift_s + _air_time(high, standing)
        fly_high(score, lift_s, _OFF_TOES * standing, land_s, _ON_TOES * standing)
        for side in SIDES:
            _leap(score, side, (lift_s, land_s), _drifted(score, side, i == count - 1), high, 0.35)
        _hop_posture(score, 0.5 * (lift_s + land_s), -0.04)
        ground_s = score.vary(0.24, 0.06) / style.tempo
        _hop_posture(score, land_s + 0.5 * ground_s, 0.10)
        lift_s = land_s + ground_s
    _recover(score, lift_s - ground_s, 0.93)


def _hops_on_one(score: Score, side: str, count: int) -> None:
    """Raise the other foot, hop, set it down again."""
    start, style, standing = score.time_s, score.style, score.body.standing_m
    score.anchor(start)
    other = "r" if side == "l" else "l"
    lift_s = start + HELD_S + 0.55 / style.tempo
    high = 0.055 * style.amplitude * style.bounce
    score.set(lift_s - 0.26, height=0.945 * standing)
    _hop_posture(score, lift_s - 0.26, 0.12, outward(side) * 0.06)
    for i in range(count):
        rise = score.vary(high, 0.12)
        land_s = lift_s + _air_time(rise, standing)
        fly_high(score, lift_s, _OFF_TOES * standing, land_s, _ON_TOES * standing)
        _leap(score, side, (lift_s, land_s), _drifted(score, side, i == count - 1), rise, 0.30)
        _bob(score, other, lift_s, land_s, rise)
        _hop_posture(score, 0.5 * (lift_s + land_s), 0.0, outward(side) * 0.05)
        ground_s = score.vary(0.27, 0.05) / style.tempo
        _hop_posture(score, land_s + 0.5 * ground_s, 0.12, outward(side) * 0.07)
        lift_s = land_s + ground_s
    last_s = lift_s - ground_s
    at = score.feet[side].current
    x, z = _under(score, side, at)
    back = score.placement(other, x, z, score.heading_rad)
    score.step(
        other, Swing(start + 0.3, last_s + 0.55, back, 0.20 * score.body.leg_m, held=True),
        heel_up_rad=0.55, toe_up_rad=-0.10,
    )  # fmt: skip
    score.set(last_s + 0.15, **{f"{other}.lift": 0.0, f"{other}.pitch": 0.65})
    _recover(score, last_s, 0.945, 0.75)


def _bob(score: Score, side: str, lift_s: float, land_s: float, rise_m: float) -> None:
    """Let a raised foot go up and down with the body."""
    middle = 0.5 * (lift_s + land_s)
    score.set(lift_s - 0.12, **{f"{side}.lift": -0.3 * rise_m, f"{side}.pitch": 0.75})
    score.set(middle, **{f"{side}.lift": 0.9 * rise_m, f"{side}.pitch": 0.60 + score.jitter(0.05)})
    score.set(land_s + 0.12, **{f"{side}.lift": -0.3 * rise_m, f"{side}.pitch": 0.75})


def _air_time(rise_m: float, standing_m: float) -> float:
    """Return the time from take-off to landing for a rise of the root by `rise_m`."""
    drop = rise_m + (_OFF_TOES - _ON_TOES) * standing_m
    return float(np.sqrt(2.0 * rise_m / GRAVITY_M_S2) + np.sqrt(2.0 * drop / GRAVITY_M_S2))


def _drifted(score: Score, side: str, last: bool) -> Placement:
    at = score.feet[side].current
    if last:
        return at
    return Placement(at.x_m + score.jitter(0.012), at.z_m + score.jitter(0.012), at.yaw_rad + score.jitter(0.02))


def _under(score: Score, side: str, at: Placement) -> tuple[float, float]:
    """Return the body's ground point for a foot of one side at `at`."""
    there = score.placement(side, 0.0, 0.0, score.heading_rad)
    return at.x_m - there.x_m, at.z_m - there.z_m


def _leap(
    score: Score, side: str, air_s: tuple[float, float], to: Placement, rise_m: float, land_up_rad: float,
    fold_m: float = 0.0,
) -> None:  # fmt: skip
    """Lift a foot over its ball and set it down on it, with the body's flight."""
    uneven = 0.005 + 0.08 * score.style.asymmetry  # nobody leaves and meets the ground with both feet at once
    lift_s, land_s = air_s[0] - abs(score.jitter(uneven)), air_s[1] + abs(score.jitter(uneven))
    spot = Placement(to.x_m + score.jitter(0.01), to.z_m + score.jitter(0.015), to.yaw_rad + score.jitter(0.03))
    score.step(
        side, Swing(lift_s, land_s, spot, rise_m + 0.02 + fold_m, power=1.6),
        heel_up_rad=score.vary(0.80, 0.05), toe_up_rad=-score.vary(land_up_rad, 0.1), rise_s=0.13, roll_s=0.10,
    )  # fmt: skip


def _hop_posture(score: Score, time_s: float, give: float, lean: float = 0.0) -> None:
    """Key trunk and arms of a hop.

    Args:
        give: positive when the body sinks.
        lean: the trunk's bend to the left.
    """
    style = score.style
    score.set(
        time_s,
        pelvis=(score.jitter(0.03), 0.06 + 0.8 * give, 0.4 * lean),
        spine=(0.04 + style.slouch_rad + give, lean + score.jitter(0.01), score.jitter(0.04)),
        head=(score.jitter(0.04), 0.05 + style.head_drop_rad - 0.2 * give, 0.0),
    )
    for side in SIDES:
        swing = 0.10 + (-1.6 * give + score.jitter(0.05)) * style.arm_swing
        out = 0.30 + (-0.8 * give + abs(score.jitter(0.05))) * style.arm_swing + 3.0 * abs(lean) * 0.8
        values: dict[str, ArrayLike] = {
            f"{side}.arm": (swing, out, 0.15),
            f"{side}.elbow": 0.95 - 1.2 * give + score.jitter(0.06),
            f"{side}.grip": 0.35,
            f"{side}.hand": (score.jitter(0.05), 0.05 - 0.8 * give, 0.0),
            f"{side}.shrug": (0.02 - 0.3 * give, 0.0),
        }
        score.set(time_s, **values)


def _recover(score: Score, land_s: float, low: float, rise_s: float = 0.65) -> None:
    """Give way after the last landing and stand up."""
    standing = score.body.standing_m
    score.set(land_s + 0.16, height=low * standing)
    rest_s = land_s + 0.16 + rise_s / score.style.tempo
    score.set(rest_s, height=STANDING_HEIGHT * standing, **score.at_ease())
    score.time_s = rest_s + 0.1


# ---- jumping


def _jump_once(score: Score, kind: str) -> None:
    start, style, standing = score.time_s, score.style, score.body.standing_m
    score.anchor(start)
    rise = max(0.10, score.vary(0.26, 0.18) * style.amplitude * (0.6 if kind in ("side", "star") else 1.0))
    depth = (0.20 + 0.30 * rise) * standing * score.vary(1.0, 0.08)
    low, off = standing - depth, _OFF_TOES * standing
    speed = float(np.sqrt(2.0 * GRAVITY_M_S2 * rise))
    sunk_s = start + score.vary(0.52, 0.08) / style.tempo
    lift_s = sunk_s + 2.0 * (off - low) / speed
    land_s = lift_s + _air_time(rise, standing)
    score.set(sunk_s, height=low)
    fly_high(score, lift_s, off, land_s, _ON_TOES * standing)
    turn = _jump_feet(score, kind, lift_s, land_s, rise)
    caught_s = land_s + score.vary(0.20, 0.1)
    caught = standing * (0.86 - 0.25 * rise) * score.vary(1.0, 0.02)
    score.set(caught_s, height=caught)
    _jump_trunk(score, kind, (sunk_s, lift_s, land_s, caught_s), turn)
    _jump_arms(score, kind, (sunk_s, lift_s, land_s, caught_s))
    rest_s = caught_s + score.vary(0.55, 0.1) / style.tempo
    rest_s = max(rest_s, max(score.feet[side].free_s for side in SIDES) + 0.12)
    score.set(rest_s, height=STANDING_HEIGHT * standing, **score.at_ease())
    score.time_s = rest_s + max(0.05, score.vary(0.2, 0.4))


def _jump_feet(score: Score, kind: str, lift_s: float, land_s: float, rise_m: float) -> float:
    """Step both feet through the air; return the heading on landing."""
    x, z = score.spot
    front = score.front_rad
    heading = front + score.jitter(0.04)
    width, fold = 1.1, 0.0
    way = score.style.amplitude * score.vary(0.40, 0.15)
    dx = dz = 0.0
    if kind in ("forward", "back"):
        dz = way if kind == "forward" else -0.7 * way
    elif kind == "side":
        dx = -0.7 * way * float(np.sign(x if abs(x) > 0.05 else score.jitter(1.0) + 1e-3))
    elif kind == "turn":
        away = abs(score.heading_rad - front) > 0.5
        heading = front if away else front + float(score.rng.choice([-1.0, 1.0])) * score.vary(1.3, 0.08)
    elif kind == "tuck":
        fold = 0.16 * score.body.leg_m / 0.85
    elif kind == "star":
        width = 2.6
    ground = turned(np.array(0.0), np.array(dz), np.array(dx))
    for side in SIDES:
        to = score.placement(side, x + float(ground[0]), z + float(ground[1]), heading, width)
        _leap(score, side, (lift_s, land_s), to, rise_m, 0.45, fold)
    if kind == "star":
        _close_feet(score, land_s, heading)
    score.anchor(lift_s - 0.08, "heading")
    score.set(land_s, heading=heading)
    return heading


def _close_feet(score: Score, land_s: float, heading_rad: float) -> None:
    """Step back from a straddle, one foot after the other."""
    x, z = score.spot
    begin = land_s + 0.45
    for i, side in enumerate(SIDES):
        to = score.placement(side, x, z, heading_rad)
        score.step(side, Swing(begin + 0.36 * i, begin + 0.30 + 0.36 * i, to, 0.05), heel_up_rad=0.4)


def _jump_trunk(score: Score, kind: str, times_s: tuple[float, float, float, float], heading: float) -> None:
    sunk_s, lift_s, land_s, caught_s = times_s
    slouch, drop = score.style.slouch_rad, score.style.head_drop_rad
    lean = {"forward": 0.12, "back": -0.08}.get(kind, 0.0)
    pitches = {sunk_s: (0.55 + lean, 0.30), lift_s: (0.06 + lean, -0.02), caught_s: (0.38 - lean, 0.22)}
    pitches[0.5 * (lift_s + land_s)] = (0.30, 0.25) if kind == "tuck" else (0.02, 0.02)
    for time_s, (pelvis, spine) in pitches.items():
        aside = score.jitter(0.015)
        score.set(
            time_s,
            pelvis=(score.jitter(0.02), pelvis * score.vary(1.0, 0.08), 0.0),
            spine=(spine * score.vary(1.0, 0.1) + slouch, aside, score.jitter(0.03)),
            head=(score.jitter(0.03), 0.4 * pelvis + drop, 0.0),
        )


def _jump_arms(score: Score, kind: str, times_s: tuple[float, float, float, float]) -> None:
    sunk_s, lift_s, land_s, caught_s = times_s
    reach = score.style.arm_swing * score.vary(1.0, 0.1)
    up = {"high": 2.45, "tuck": 1.4, "star": 0.5, "forward": 1.9}.get(kind, 1.6) * (0.6 + 0.4 * reach)
    out = {"star": 2.0, "turn": 0.6, "side": 0.7}.get(kind, 0.22)
    for side in SIDES:
        share = 1.0 + score.style.asymmetry * outward(side)
        keys: dict[float, tuple[float, float, float, float]] = {
            sunk_s: (-0.60 * reach * share, 0.22, -0.1, 0.30),
            lift_s - 0.02: (0.70 * up * share, 0.22 + 0.4 * (out - 0.22), 0.1, 0.65),
            0.5 * (lift_s + land_s): (up * share, out, 0.0, 0.35),
            land_s + 0.02: (0.45 * up, 0.35 + 0.25 * (out - 0.22), 0.1, 0.60),
            caught_s + 0.05: (0.40 + score.jitter(0.15), 0.35, 0.2, 0.75),
        }
        for time_s, (flex, abduct, twist, bend) in keys.items():
            values: dict[str, ArrayLike] = {
                f"{side}.arm": (flex, abduct + score.jitter(0.03), twist),
                f"{side}.elbow": bend * score.vary(1.0, 0.1),
                f"{side}.grip": 0.30,
                f"{side}.hand": (0.05 + score.jitter(0.05), 0.05, 0.0),
            }
            score.set(time_s, **values)
