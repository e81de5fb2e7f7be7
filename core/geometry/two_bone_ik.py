"""Inverse kinematics of two bones in closed form, by the law of cosines."""

import numpy as np
from numpy.typing import ArrayLike

from . import quaternion_components as c
from . import rotations as rot
from .arrays import Array


def triangle_angle(near: ArrayLike, side: ArrayLike, opposite: ArrayLike) -> Array:
    """Return the angle between the sides `near` and `side` of a triangle, whose third side is `opposite`."""
    a, b, o = (np.asarray(length, dtype=np.float64) for length in (near, side, opposite))
    cosine = (a * a + b * b - o * o) / (2.0 * a * b)
    return np.asarray(np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0)))


def reach_with_two_bones(
    points: tuple[Array, Array, Array], rotations: tuple[Array, Array], target: Array, hinge: Array, straightest: float
) -> tuple[Array, Array]:
    """Return the world rotations (4,) of two bones that bring their end to a target.

    Args:
        points: Start of the first bone, joint between them, end of the second (3,).
        rotations: Current world rotations (4,) of the bones.
        target: Target (3,) relative to the start; if it is out of reach, the bones point at it.
        hinge: Unit axis (3,) about which a straight limb bends.
        straightest: Largest fraction of its length to which the limb is stretched, unless it is straighter already.
    """
    start, middle, end = points
    first, second, reach = middle - start, end - middle, end - start
    a, b, before = (float(np.linalg.norm(v)) for v in (first, second, reach))
    wanted = float(np.linalg.norm(target))
    after = min(max(wanted, abs(a - b) + 1e-6), max(straightest * (a + b), before))
    axis = np.cross(first, second)
    size = float(np.linalg.norm(axis))
    axis = axis / size if size > 1e-3 * a * b else hinge
    turn = rot.between(reach / before, target / max(wanted, 1e-9))
    at_start = triangle_angle(a, before, b) - triangle_angle(a, after, b)
    at_end = triangle_angle(b, after, a) - triangle_angle(b, before, a)
    upper, lower = (
        rot.multiply(turn, rot.multiply(rot.from_rotation_vector(axis * angle), rotation))
        for angle, rotation in zip((at_start, at_end), rotations, strict=True)
    )
    return upper, lower


def two_bone_directions(
    reach: c.Vector,
    normal: c.Vector,
    first_m: float,
    second_m: float,
    unreached: c.Vector,
    straightest: c.Part = 0.9995,
) -> tuple[c.Vector, c.Vector]:
    """Return the directions of two bones that bring their end to `reach`; all positions are relative to their start.

    Args:
        reach: Desired end of the second bone; if it is out of reach, the bones come as close as possible.
        normal: Normal of the plane in which the bones bend while they end at `unreached`; it is turned along with the
            limb.
        unreached: Current end of the second bone.
        straightest: Largest fraction of their length to which the bones are stretched.
    """
    way = c.unit(reach)
    limit = straightest * (first_m + second_m)
    distance = c.minimum(c.maximum(c.length(reach), abs(first_m - second_m) + 1e-6), limit)
    across = c.rotate(c.shortest_turn(c.unit(unreached), way), normal)
    across = c.unit(c.minus(across, c.times(c.dot(across, way), way)))
    cosine = c.minimum((first_m**2 + distance**2 - second_m**2) / (2.0 * first_m * distance), 1.0)
    sine = (1.0 - cosine * cosine) ** 0.5
    first = c.plus(c.times(cosine, way), c.times(sine, c.cross(way, across)))
    return first, c.unit(c.minus(c.times(distance, way), c.times(first_m, first)))
