"""Walking and running: steps along a path, with trunk and arms.

Times and angles are textbook values of human gait (stance 60 % of the cycle in walking, a flight phase in running,
pelvis and chest turning against each other, the arms swinging with the opposite legs).
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from .curves import Track
from .feet import Placement, Swing
from .proportions import GRAVITY_M_S2, SIDES, outward
from .timeline import Timeline


@dataclass(frozen=True)
class Gait:
    """One way of stepping; lengths are shares of the leg's length, angles are radians."""

    step_s: float  # time from one foot's landing to the other's
    duty: float  # share of the cycle of two steps in which a foot is on the ground; below 0.5 there are flights
    stride: float  # step length at which the swings of arms and trunk have the given size
    lift: float  # height of the ball of the swinging foot
    heel_up: float  # the foot's pitch when it lifts
    mid_up: float  # its largest pitch in the air
    toe_up: float  # its upward pitch when it lands
    pelvis_yaw: float
    pelvis_roll: float  # drop towards the free side
    pelvis_pitch: float
    twist: float  # rotation of the chest relative to the pelvis
    lean: float  # bend of the trunk
    arm_forward: float
    arm_back: float
    arm_out: float  # angle away from the body
    arm_in: float  # inward twist
    elbow: float
    elbow_swing: float  # additional bend in front
    grip: float
    height: float  # height of the root, as a share of standing
    dip: float  # how far the root sinks when a foot lands
    width: float  # distance between the feet, relative to the stance

    @property
    def running(self) -> bool:
        """Whether there are flights."""
        return self.duty < 0.5


WALK = Gait(
    step_s=0.54, duty=0.62, stride=0.75, lift=0.10, heel_up=0.95, mid_up=0.0, toe_up=0.32, pelvis_yaw=0.085,
    pelvis_roll=0.10, pelvis_pitch=0.05, twist=0.17, lean=0.02, arm_forward=0.36, arm_back=0.34,
    arm_out=0.10, arm_in=-0.10, elbow=0.46, elbow_swing=0.34, grip=0.28, height=0.993, dip=0.018, width=0.75,
)  # fmt: skip
RUN = Gait(
    step_s=0.365, duty=0.36, stride=0.85, lift=0.24, heel_up=0.80, mid_up=1.15, toe_up=0.05, pelvis_yaw=0.09,
    pelvis_roll=0.08, pelvis_pitch=0.12, twist=0.18, lean=0.11, arm_forward=0.62, arm_back=0.62,
    arm_out=0.14, arm_in=0.15, elbow=1.75, elbow_swing=0.30, grip=0.65, height=0.956, dip=0.0, width=0.45,
)  # fmt: skip
_ARM_REST = -0.12  # angle of the arm in front of the body in mid-swing
_LAND_BENT = 0.016  # how much lower a runner lands than takes off, share of the height


@dataclass
class _Step:
    side: str
    lift_s: float
    land_s: float
    amount: float


def styled(gait: Gait, timeline: Timeline) -> Gait:
    """Return the gait modified by style and repetition."""
    style = timeline.style
    swing = float(style.arm_swing * np.sqrt(style.amplitude))
    return replace(
        gait,
        step_s=timeline.vary(gait.step_s, 0.03) / style.tempo,
        lift=gait.lift * style.amplitude * style.bounce,
        heel_up=gait.heel_up * style.amplitude**0.5,
        toe_up=gait.toe_up * style.amplitude,
        pelvis_yaw=gait.pelvis_yaw * style.amplitude,
        twist=gait.twist * swing,
        arm_forward=gait.arm_forward * swing,
        arm_back=gait.arm_back * swing,
        elbow=max(0.1, gait.elbow + style.elbows_rad),
        dip=gait.dip * style.bounce,
        lean=gait.lean + style.slouch_rad,
    )


def stepped(timeline: Timeline, gait: Gait, path: Track, until_s: float) -> None:
    """Step along `path` from the timeline's time until both feet stand at its end.

    Args:
        path: Keys of (x, z, heading); the ground point between the ankles.
        until_s: Time after which no step in place starts; the timeline's time ends after the last landing.
    """
    steps = _planned(timeline, gait, path, until_s)
    for step in steps:
        _place(timeline, gait, step, path)
    _key_trunk_and_arms(timeline, gait, steps)
    (_key_flights if gait.running else _key_heights)(timeline, gait, steps)
    timeline.anchor(timeline.time_s, "heading")
    for time_s in np.arange(timeline.time_s + 0.15, max(steps[-1].land_s, path.keys[-1].time_s) + 0.1, 0.15):
        timeline.set(float(time_s), heading=path.value_at(float(time_s))[2])
    timeline.time_s = steps[-1].land_s + 0.12


def _planned(timeline: Timeline, gait: Gait, path: Track, until_s: float) -> list[_Step]:
    side = _first_side(timeline, path, gait)
    air = 2.0 * gait.step_s * (1.0 - gait.duty)
    land = timeline.time_s + 0.32 + air
    steps: list[_Step] = []
    settled = 0
    while settled < 2 or land - gait.step_s < until_s:
        steps.append(_Step(side, land - air, land, 1.0))
        settled = settled + 1 if _middle_of_stance(gait, land) >= path.keys[-1].time_s else 0
        side = "r" if side == "l" else "l"
        limp = 1.0 + timeline.style.asymmetry * outward(side)
        land += max(timeline.vary(gait.step_s, 0.025) * limp, 0.2)
    return steps


def _first_side(timeline: Timeline, path: Track, gait: Gait) -> str:
    """Return the foot on the side to which the path turns or leads, else a random one."""
    here = path.value_at(timeline.time_s)
    soon, heading = path.value_at(timeline.time_s + 1.5 * gait.step_s) - here, here[2]
    aside = soon[0] * np.cos(heading) - soon[1] * np.sin(heading)
    lean = aside + 0.2 * soon[2]
    if abs(lean) > 0.05:
        return "l" if lean > 0.0 else "r"
    return SIDES[timeline.one_of(2)]


def _middle_of_stance(gait: Gait, land_s: float) -> float:
    return land_s + gait.duty * gait.step_s


def _target(timeline: Timeline, gait: Gait, side: str, path: Track, land_s: float) -> Placement:
    x, z, heading = path.value_at(_middle_of_stance(gait, land_s))
    going = path.value_at(land_s + 0.1) - path.value_at(land_s - 0.1)
    speed = min(1.0, float(np.hypot(going[0], going[1])) / 0.16)
    width = 1.0 + (gait.width - 1.0) * speed  # feet are closer together when walking than when standing
    spot = timeline.placement(side, x, z, heading, width)
    scatter = 0.012 * speed
    return Placement(spot.x_m + timeline.jitter(scatter), spot.z_m + timeline.jitter(scatter), spot.yaw_rad)


def _place(timeline: Timeline, gait: Gait, step: _Step, path: Track) -> None:
    air_s = step.land_s - step.lift_s
    old = timeline.feet[step.side].current
    new = _target(timeline, gait, step.side, path, step.land_s)
    heading = float(path.value_at(step.land_s)[2])
    dx, dz = new.x_m - old.x_m, new.z_m - old.z_m
    forward = dx * np.sin(heading) + dz * np.cos(heading)
    two_steps_m = 2.0 * gait.stride * timeline.body.leg_m  # distance that a swing covers; in place some motion remains
    step.amount = float(np.clip(forward / two_steps_m, -0.6, 1.25))
    size = float(np.clip(np.hypot(dx, dz) / two_steps_m, 0.0, 1.2))
    lively = 0.75 + 0.25 * size if gait.running else 0.45 + 0.55 * size
    backwards = forward < -0.05
    heel_up = gait.heel_up * (0.5 + 0.5 * size) * (0.75 if backwards else 1.0)
    height_m = timeline.vary(gait.lift, 0.08) * lively * timeline.body.leg_m
    timeline.step(
        step.side,
        Swing(step.lift_s, step.land_s, new, height_m, peak=0.48 if gait.running else 0.42),
        heel_up_rad=heel_up,
        toe_up_rad=-0.25 * size if backwards else gait.toe_up * min(1.0, size * 1.3),
        rise_s=0.45 * gait.duty * 2.0 * gait.step_s,
        roll_s=0.22 * gait.duty * gait.step_s,
    )
    if gait.mid_up > 0.0:
        peak = gait.mid_up * (0.75 + 0.35 * size) * timeline.vary(1.0, 0.05)
        timeline.set_side(step.side, step.lift_s + 0.36 * air_s, pitch=max(peak, heel_up))


def _key_trunk_and_arms(timeline: Timeline, gait: Gait, steps: list[_Step]) -> None:
    timeline.anchor(timeline.time_s)
    for step in steps:
        last = step is steps[-1]
        amount = 0.55 + 0.45 * min(1.0, abs(step.amount)) if gait.running else step.amount
        if last:
            amount *= 0.35
        s = outward(step.side)
        turn = -s * gait.pelvis_yaw * amount * timeline.vary(1.0, 0.12)
        land, middle = step.land_s, step.land_s + 0.5 * gait.step_s
        free = abs(amount) ** 0.5 * gait.pelvis_roll * s * timeline.vary(1.0, 0.15)
        twist = (s * gait.twist * amount - turn) * 0.9
        timeline.set(
            land,
            pelvis=(turn, gait.pelvis_pitch, 0.0),
            spine=(gait.lean + timeline.jitter(0.01), 0.0, twist),
            head=(timeline.jitter(0.05), 0.06 + timeline.style.head_drop_rad + timeline.jitter(0.02), 0.0),
        )
        if not last:
            timeline.set(middle, pelvis=(0.2 * turn, gait.pelvis_pitch, free))
            timeline.set(middle, spine=(gait.lean, 0.8 * free, 0.15 * twist))  # the chest stays level
        for side in SIDES:
            _key_arm(timeline, gait, side, land + 0.05 * gait.step_s, amount if side != step.side else -amount)


def _key_arm(timeline: Timeline, gait: Gait, side: str, time_s: float, amount: float) -> None:
    """Key an arm at the end of its swing: forward for a positive amount."""
    share = 1.0 + timeline.style.asymmetry * outward(side)
    reach = gait.arm_forward if amount > 0.0 else gait.arm_back
    swing = amount * reach * share * timeline.vary(1.0, 0.10)
    bend = gait.elbow + gait.elbow_swing * (amount if amount > 0.0 else 0.6 * amount) * timeline.vary(1.0, 0.1)
    inward = gait.arm_in + (0.25 if gait.running else 0.08) * max(amount, 0.0)
    timeline.set_side(
        side,
        time_s,
        arm=(_ARM_REST + swing, gait.arm_out + 0.02 * abs(amount) + timeline.jitter(0.015), inward),
        elbow=max(0.1, bend),
        hand=(0.05 + timeline.jitter(0.05), 0.12 + 0.10 * amount, timeline.jitter(0.04)),
        grip=gait.grip,
        shrug=(0.0, 0.05 * amount),
    )


def _key_heights(timeline: Timeline, gait: Gait, steps: list[_Step]) -> None:
    standing = timeline.body.standing_m
    high = gait.height * standing
    for step in steps:
        size = abs(step.amount)
        timeline.set(step.land_s, height=high - gait.dip * (0.3 + size) * standing)
        rise = 0.004 * size * timeline.style.bounce * standing
        if step is not steps[-1]:
            timeline.set(step.land_s + 0.48 * gait.step_s, height=high + rise + timeline.jitter(0.002))
    timeline.set(steps[-1].land_s + 0.45, height=timeline.standing_m)


def _key_flights(timeline: Timeline, gait: Gait, steps: list[_Step]) -> None:
    """Key free flight of the body from each lift-off to the next landing; the stance's curve connects to its ends."""
    height = gait.height * timeline.body.standing_m
    for before, after in pairwise(steps):
        lift, land = after.lift_s, before.land_s
        if lift >= land or lift <= before.lift_s:
            continue
        # take off from the toes of a straightened leg, land on a bent one
        if timeline.tracks["height"].keys[-1].time_s < lift - 0.45:  # before the first flight, sink a little
            timeline.set(lift - 0.24, height=0.965 * height)
        # long strides need lower hips
        tall = height * (1.0 + 0.024 * (1.0 - min(1.0, abs(after.amount))))
        fly_high(timeline, lift, tall * (1.0 + 0.5 * _LAND_BENT), land, tall * (1.0 - 0.5 * _LAND_BENT))
    timeline.set(steps[-1].land_s + 0.30, height=timeline.standing_m)


def fly_high(timeline: Timeline, lift_s: float, lift_m: float, land_s: float, land_m: float) -> None:
    """Key the root's height for a free flight between two heights at two times."""
    air, track = land_s - lift_s, timeline.tracks["height"]
    up = (land_m - lift_m) / air + 0.5 * GRAVITY_M_S2 * air
    track.key(lift_s, lift_m, up, -GRAVITY_M_S2)
    track.key(land_s, land_m, up - GRAVITY_M_S2 * air, -GRAVITY_M_S2)
