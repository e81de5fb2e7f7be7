"""Inverse kinematics of two bones in closed form, by the law of cosines."""

import numpy as np
from numpy.typing import ArrayLike

from . import quaternion_components as c
from .arrays import Array


def triangle_angle(near: ArrayLike, side: ArrayLike, opposite: ArrayLike) -> Array:
    """Return the angle between the sides `near` and `side` of a triangle, whose third side is `opposite`."""
    a, b, o = (np.asarray(length, dtype=np.float64) for length in (near, side, opposite))
    cosine = (a * a + b * b - o * o) / (2.0 * a * b)
    return np.asarray(np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0)))


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
