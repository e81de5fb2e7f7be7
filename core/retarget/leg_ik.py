"""Inverse kinematics of a character's legs: it puts the feet where the performer's are.

The ball of each foot is above the same place as the performer's, and the sole is as high above the floor: where the
performer stands, the lowest point of the character's sole is on the floor, whatever its rest pose stands on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.skeleton import Skeleton
from ..body.soles import Sole, performer_sole, upright_foot
from ..geometry import quaternion_components as c
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.two_bone_ik import two_bone_directions
from .character_rest_pose import RestAlignment


@dataclass(frozen=True)
class LegSettings:
    """Proportions of legs, and lowering of the hips for a foot that is out of reach."""

    reach: float = 0.9995  # largest stretch of a leg, in leg lengths
    softness: float = 0.005  # range over which the lowering sets in smoothly, in leg lengths
    standing_cosine: float = 0.75  # cosine between leg and vertical above which the hips are lowered fully
    raised_cosine: float = 0.45  # cosine below which the hips are not lowered
    hinge: float = 0.05  # weight of the knee's hinge axis in the normal of the leg's plane, for straight legs
    heel_steps: int = 3  # corrections of the ankle's height for a heel that turns with the shank


_SETTINGS = LegSettings()


@dataclass(frozen=True)
class _Leg:
    """Indices and lengths of a leg, in the performer's metres; values named `own` are the performer's.

    Args:
        joints: Thigh, shank, foot and toes among the performer's joints.
        places: The same among the driven bones; without a bone for the toes, the foot's stands for them.
    """

    joints: tuple[int, ...]
    places: tuple[int, ...]
    own_hip: c.Vector
    own_thigh_m: float
    own_shank_m: float
    thigh_way: c.Vector
    shank_way: c.Vector
    hinge: c.Vector
    thigh_m: float
    shank_m: float
    from_middle: c.Vector
    ankle_shift: c.Vector
    own_sole: Sole
    sole: Sole
    heel: Sole | None  # part of the sole that turns with the shank


@dataclass(frozen=True)
class _Step:
    """Rotations of the performer's leg, the target for the character's ankle, and the height of the lowest sole."""

    upper: c.Quaternion
    lower: c.Quaternion
    thigh_way: c.Vector
    shank_way: c.Vector
    ankle: c.Vector
    sole_m: c.Part


@dataclass(frozen=True)
class LegPlan:
    """Both legs of a character and its hips, in the performer's metres.

    Args:
        hips_to_middle: Vector from the hips' head to the midpoint between the thighs.
        own_middle: The same for the performer.
        hips_up: Height added to the hips, because the character's ankles are higher above its soles.
        legs: Legs with knee and ankle; others keep the rotations of their joints.
        softness: Range over which the lowering sets in smoothly, in leg lengths.
    """

    hips_to_middle: c.Vector
    own_middle: c.Vector
    hips_up: float
    legs: tuple[_Leg, ...]
    softness: float = _SETTINGS.softness


def plan_legs(
    skeleton: Skeleton,
    alignment: RestAlignment,
    joints: Mapping[str, int],
    places: Mapping[int, int],
    soles: Mapping[str, Sole],
    heels: Mapping[str, Sole | None],
    hip_height_m: float = 0.0,
) -> LegPlan:
    """Compare the legs of a character with the performer's.

    Args:
        joints: Joint -> index of the character's bone.
        places: Index of a bone -> its index among the driven bones.
        soles: Side -> the character's sole, for sides with a foot.
        heels: Side -> the part of the sole that turns with the shank, None for none.
        hip_height_m: Height added to the hips.
    """
    heads = alignment.heads_m
    middle = 0.5 * (heads[joints["lfemur"]] + heads[joints["rfemur"]])
    thighs = skeleton.offsets_m[[skeleton.index(side + "femur") for side in "lr"]]
    legs, up = [], []
    for side in "lr":
        if all(side + name in joints for name in ("femur", "tibia", "foot")):
            leg, leg_up = _plan_leg(skeleton, alignment, joints, places, side, (soles[side], heels[side]))
            legs.append(leg)
            up.append(leg_up)
    return LegPlan(
        c.components(middle - heads[joints["root"]]),
        c.components(np.mean(thighs, axis=0)),
        hip_height_m + (float(np.mean(up)) if up else 0.0),
        tuple(legs),
    )


def _plan_leg(
    skeleton: Skeleton,
    alignment: RestAlignment,
    joints: Mapping[str, int],
    places: Mapping[int, int],
    side: str,
    touching: tuple[Sole, Sole | None],
) -> tuple[_Leg, float]:
    """Return a leg and how much higher its ankle is above the sole of a standing foot than the performer's."""
    heads, (sole, heel) = alignment.heads_m, touching
    middle = 0.5 * (heads[joints["lfemur"]] + heads[joints["rfemur"]])
    thigh, shank, own_ball = (skeleton.offsets_m[skeleton.index(side + n)] for n in ("tibia", "foot", "toes"))
    femur, tibia, foot = (joints[side + name] for name in ("femur", "tibia", "foot"))
    to_ball = own_ball
    if side + "toes" in joints:
        to_ball = rot.rotate(alignment.turns[side + "foot"], heads[joints[side + "toes"]] - heads[foot])
    lengths = [float(np.linalg.norm(heads[b] - heads[a])) for a, b in ((femur, tibia), (tibia, foot))]
    own_sole, upright = performer_sole(skeleton, side), upright_foot(skeleton, side)
    toes = joints.get(side + "toes", foot)
    # the hinge points to the left (down x back), because knees bend the shank backwards
    hinge = np.cross(thigh, [0.0, 0.0, -1.0])
    leg = _Leg(
        joints=tuple(skeleton.index(side + name) for name in ("femur", "tibia", "foot", "toes")),
        places=tuple(places[bone] for bone in (femur, tibia, foot, toes)),
        own_hip=c.components(skeleton.offsets_m[skeleton.index(side + "femur")]),
        own_thigh_m=float(np.linalg.norm(thigh)),
        own_shank_m=float(np.linalg.norm(shank)),
        thigh_way=c.unit(c.components(thigh)),
        shank_way=c.unit(c.components(shank)),
        hinge=c.unit(c.components(hinge)),
        thigh_m=lengths[0],
        shank_m=lengths[1],
        from_middle=c.components(heads[femur] - middle),
        ankle_shift=c.components(own_ball - to_ball),
        own_sole=own_sole,
        sole=sole,
        heel=heel,
    )
    return leg, float(own_sole.lowest_m(upright, upright) - sole.lowest_m(upright, upright))


def bend_legs(plan: LegPlan, world: Array, root: c.Quaternion, position: c.Vector, turned: Array) -> c.Vector:
    """Turn thighs and shanks in `turned`, and return the hips' position in metres.

    Args:
        world: Orientations (..., J, 4) of the performer's joints.
        turned: World rotations (..., N, 4) of the driven bones; those of the legs are changed.
    """
    middle = c.plus(c.plus(position, c.rotate(root, plan.own_middle)), (0.0, plan.hips_up, 0.0))
    flat = [_step(leg, world, root, position, turned) for leg in plan.legs]
    hips = [c.plus(middle, c.rotate(root, leg.from_middle)) for leg in plan.legs]
    lower: c.Part = 0.0
    steps = flat
    for _ in range(1 + _SETTINGS.heel_steps * any(leg.heel is not None for leg in plan.legs)):
        lower = _lowering(plan, [c.minus(step.ankle, hip) for step, hip in zip(steps, hips, strict=True)])
        for leg, step, hip in zip(plan.legs, steps, hips, strict=True):
            _bend_leg(leg, step, c.minus(step.ankle, c.minus(hip, (0.0, lower, 0.0))), turned)
        steps = [_on_heel(leg, step, turned) for leg, step in zip(plan.legs, flat, strict=True)]
    return c.minus(c.minus(middle, (0.0, lower, 0.0)), c.rotate(root, plan.hips_to_middle))


def _on_heel(leg: _Leg, step: _Step, turned: Array) -> _Step:
    """Return the step with the ankle raised so that a heel that turns with the shank is no lower than the sole."""
    if leg.heel is None:
        return step
    shank, (x, height, z) = turned[..., leg.places[1], :], step.ankle
    return replace(step, ankle=(x, c.maximum(height, step.sole_m - leg.heel.lowest_m(shank, shank)), z))


def _step(leg: _Leg, world: Array, root: c.Quaternion, position: c.Vector, turned: Array) -> _Step:
    upper, lower, end = (c.components(world[..., joint, :]) for joint in leg.joints[:3])
    thigh_way, shank_way = c.rotate(upper, leg.thigh_way), c.rotate(lower, leg.shank_way)
    ankle = c.plus(position, c.rotate(root, leg.own_hip))
    ankle = c.plus(ankle, c.plus(c.times(leg.own_thigh_m, thigh_way), c.times(leg.own_shank_m, shank_way)))
    sole_m = ankle[1] + leg.own_sole.lowest_m(*(world[..., joint, :] for joint in leg.joints[2:]))
    height = sole_m - leg.sole.lowest_m(*(turned[..., place, :] for place in leg.places[2:]))
    x, _, z = c.plus(ankle, c.rotate(end, leg.ankle_shift))
    return _Step(upper, lower, thigh_way, shank_way, (x, height, z), sole_m)


def readjusted_legs(before: LegPlan, after: LegPlan) -> LegPlan:
    """Return a plan for poses of a character's own body that were made with one plan, as another would make them."""
    legs = tuple(
        replace(leg, own_sole=own.sole, heel=None, ankle_shift=c.minus(leg.ankle_shift, own.ankle_shift))
        for own, leg in zip(before.legs, after.legs, strict=True)
    )
    # without softness, a pose that is made again and again stays the same
    return replace(after, hips_up=after.hips_up - before.hips_up, legs=legs, softness=0.0)


def _lowering(plan: LegPlan, reaches: Sequence[c.Vector]) -> c.Part:
    """Return how far to lower the hips, metres, so that standing legs reach the floor.

    Args:
        reaches: Vectors from each hip to the target of its ankle.
    """
    lowest: c.Part = 0.0
    for leg, reach in zip(plan.legs, reaches, strict=True):
        limit = _SETTINGS.reach * (leg.thigh_m + leg.shank_m)
        across = reach[0] * reach[0] + reach[2] * reach[2]
        down = -reach[1]
        over = down - c.maximum(limit * limit - across, 0.0) ** 0.5
        over = 0.5 * (over + (over * over + (plan.softness * limit) ** 2) ** 0.5)
        cosine, raised = down / ((across + down * down) ** 0.5 + 1e-9), _SETTINGS.raised_cosine
        steep = (cosine - raised) / (_SETTINGS.standing_cosine - raised)
        lowest = c.maximum(lowest, over * c.minimum(c.maximum(steep, 0.0), 1.0))
    return lowest


def _bend_leg(leg: _Leg, step: _Step, reach: c.Vector, turned: Array) -> None:
    """Turn thigh and shank until the vector from hip to ankle is `reach`."""
    hinge = c.times(_SETTINGS.hinge, c.rotate(step.upper, leg.hinge))
    normal = c.plus(c.cross(step.thigh_way, step.shank_way), hinge)
    unreached = c.plus(c.times(leg.thigh_m, step.thigh_way), c.times(leg.shank_m, step.shank_way))
    thigh, shank = two_bone_directions(reach, normal, leg.thigh_m, leg.shank_m, unreached)
    for place, before, after, turn in (
        (leg.places[0], step.thigh_way, thigh, step.upper),
        (leg.places[1], step.shank_way, shank, step.lower),
    ):
        turned[..., place, :] = c.stacked(c.multiply(c.shortest_turn(before, after), turn))
