"""Soles of a character, from its mesh or, without one, from its lowest bones."""

from collections.abc import Mapping
from itertools import product

import numpy as np

from ..body.soles import Sole
from ..geometry import rotations as rot
from .armature_rest import ArmatureRest
from .character_fit import SkinPoints
from .character_rest_pose import RestAlignment
from .driven_bones import neighbours

# poses of a foot whose lowest points are kept: pitch and roll of the foot, bend of the toes, degrees
_PITCHES, _ROLLS, _BENDS = (-30.0, -15.0, -5.0, 0.0, 5.0, 15.0, 30.0, 45.0, 60.0, 80.0), (-20.0, 0.0, 20.0), (0.0, 40.0)
_HEEL_M = 0.02  # largest height above the sole of points of the shank's skin that touch the floor


def character_sole(
    rest: ArmatureRest, alignment: RestAlignment, joints: Mapping[str, int], side: str, skin: SkinPoints | None
) -> Sole:
    """Return the sole of a character's foot in the standard rest pose.

    Args:
        joints: Joint -> index of the character's bone, with the side's foot.
        skin: Points of the mesh; None for the bones' ends.
    """
    ankle, ball = joints[side + "foot"], joints.get(side + "toes", -1)
    heads, balls = alignment.heads_m, [ball if ball >= 0 else ankle]
    if skin is None or len(skin.points) == 0:
        skin, balls = _bone_ends(rest, ankle, ball)
    points = skin.points @ alignment.armature_from_world / alignment.units_per_metre - heads[ankle]
    to_ball = heads[balls] - heads[ankle]
    sole = Sole.skinned(points, skin.toe_weights if ball >= 0 else np.zeros(len(points)), to_ball)
    foot = alignment.turns[side + "foot"]
    return _outline(sole).turned(foot, alignment.turns.get(side + "toes", foot))


def character_heel(
    alignment: RestAlignment, joints: Mapping[str, int], side: str, skin: SkinPoints | None, sole: Sole
) -> Sole | None:
    """Return the part of a character's sole that its shank moves, as a sole relative to the ankle; None without one.

    Boots and robots may be one piece from the shin to the heel, so that the heel turns with the shank.

    Args:
        sole: Part of the sole that the foot moves.
    """
    if skin is None or side + "tibia" not in joints:
        return None
    points = skin.shank @ alignment.armature_from_world / alignment.units_per_metre
    points = points - alignment.heads_m[joints[side + "foot"]]
    foot, shank = (alignment.turns[side + name] for name in ("foot", "tibia"))
    toes = alignment.turns.get(side + "toes", foot)
    lowest_m = float(sole.lowest_m(rot.conjugate(foot), rot.conjugate(toes)))
    low = points[points[:, 1] < lowest_m + _HEEL_M]
    if len(low) == 0:
        return None
    return _outline(Sole(low, np.zeros_like(low))).turned(shank, shank)


def _bone_ends(rest: ArmatureRest, ankle: int, ball: int) -> tuple[SkinPoints, list[int]]:
    """Return both ends of the bones below the ankle, with the ankle's head, and the toe of each, else the ankle."""
    below = [bone for bone in range(ankle + 1, len(rest)) if rest.is_above(ankle, bone)]
    toes = [ball, *neighbours(rest, ball)] if ball >= 0 else []
    ends, balls = [rest.heads[ankle]], [ankle]
    for bone in below:
        ends += [rest.heads[bone], rest.tails[bone]]
        balls += 2 * [next((toe for toe in toes if bone == toe or rest.is_above(toe, bone)), ankle)]
    if not below:
        ends.append(rest.tails[ankle])
        balls.append(ankle)
    return SkinPoints(np.array(ends), np.array([float(toe != ankle) for toe in balls])), balls


def _outline(sole: Sole) -> Sole:
    """Return the points that are lowest in some pose of the foot."""
    kept = set()
    for pitch, roll, bend in product(_PITCHES, _ROLLS, _BENDS):
        foot = rot.from_euler(np.radians([roll, pitch]), "ZX")
        toes = rot.multiply(foot, rot.from_euler(np.radians([-bend]), "X"))
        kept.add(int(np.argmin(sole.foot @ rot.vertical_in(foot) + sole.toes @ rot.vertical_in(toes))))
    rows = sorted(kept)
    return Sole(sole.foot[rows], sole.toes[rows])
