"""Size of a body: stature, its ratio to the default skeleton's, human statures, height of the root above the soles."""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from .skeleton import Skeleton
from .standard_skeleton import default_skeleton

SOLE_BELOW_TOES_M = 0.024  # distance of the sole below the toe joints of the default skeleton
_STATURE_M = 1.72  # stature of the default skeleton: 1.63 m from soles to end of the head bone, plus the skull above


@dataclass(frozen=True)
class HumanSize:
    """Statures of people, used to detect wrong units."""

    shortest_m: float = 0.72  # a small child; a body whose inches are read as centimetres is smaller
    tallest_m: float = 2.4
    largest_m: float = 4.0  # largest estimate from torso markers, which are rough: misplaced ones can double it


HUMAN = HumanSize()
_SPINE = ("lowerback", "upperback", "thorax", "lowerneck", "upperneck")
_LEGS = ("lfemur", "ltibia", "rfemur", "rtibia")


def girth_scale(skeleton: Skeleton) -> float:
    """Return a body's size relative to the default skeleton's."""
    return _height_m(skeleton) / _height_m(default_skeleton())


def stature_m(skeleton: Skeleton) -> float:
    """Return the stature of a body, from the soles to the top of the head."""
    return girth_scale(skeleton) * _STATURE_M


def standing_root_m(skeleton: Skeleton) -> Array:
    """Return the root's position (3,) in the rest pose with the soles on the floor, y = 0."""
    toes = min(skeleton.rest_positions_m[skeleton.index(side + "toes")][1] for side in "lr")
    return np.array([0.0, SOLE_BELOW_TOES_M * girth_scale(skeleton) - toes, 0.0])


def _height_m(skeleton: Skeleton) -> float:
    """Return a length proportional to stature: spine and legs laid end to end."""
    lengths = np.linalg.norm(skeleton.tips_m, axis=1)
    spine = sum(lengths[skeleton.index(name)] for name in _SPINE)
    return float(spine + 0.5 * sum(lengths[skeleton.index(name)] for name in _LEGS))
