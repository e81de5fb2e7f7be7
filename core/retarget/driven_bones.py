"""Bones of a character that a motion turns, and the joints that turn them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..body.skeleton import Skeleton
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from .armature_rest import ArmatureRest
from .bone_name_parser import parse_bone_name

_CHAINS = (("root", "lowerback", "upperback", "thorax"), ("thorax", "lowerneck", "upperneck", "head"))
_FINGERS = ("index", "middle", "ring", "pinky", "little")


@dataclass(frozen=True)
class DrivenBone:
    """A bone, the two joints that turn it, its position between them (0 to 1), and its rest-pose alignment."""

    bone: int
    first: int
    second: int
    share: float
    turn: Array


def root_bone(rest: ArmatureRest, hips: int) -> int:
    """Return the topmost ancestor of the hips that is not a helper, or -1 if there is none."""
    above = [bone for bone in rest.line(hips)[1:] if not parse_bone_name(rest.names[bone]).helper]
    if above:
        return above[-1]
    return rest.index.get("root", -1) if rest.parents[hips] >= 0 else -1


def driven_bones(
    skeleton: Skeleton, rest: ArmatureRest, joints: dict[str, int], turns: dict[str, Array]
) -> list[DrivenBone]:
    """Return all bones driven by the skeleton's joints, parents first."""
    driven: dict[int, DrivenBone] = {}
    for joint, bone in joints.items():
        index = skeleton.index(joint)
        driven[bone] = DrivenBone(bone, index, index, 0.0, turns[joint])
    for chain in _CHAINS:
        pins = [joint for joint in chain if joint in joints]
        for lower, upper in pairwise(pins):
            path = rest.path(joints[lower], joints[upper])
            way = rest.distances(path)
            for bone, share in zip(path[1:-1], way[1:-1] / max(float(way[-1]), 1e-9), strict=True):
                if bone not in driven and not parse_bone_name(rest.names[bone]).helper:
                    first, second = skeleton.index(lower), skeleton.index(upper)
                    driven[bone] = DrivenBone(bone, first, second, float(share), rot.identity())
    for joint in [side + name for side in "lr" for name in ("fingers", "toes") if side + name in joints]:
        for bone in neighbours(rest, joints[joint]):
            if bone not in driven:
                driven[bone] = DrivenBone(bone, skeleton.index(joint), skeleton.index(joint), 0.0, turns[joint])
    return [driven[bone] for bone in sorted(driven)]


def neighbours(rest: ArmatureRest, bone: int) -> list[int]:
    """Return the other fingers or toes, which turn as this one does."""
    return [rest.index[name] for name in neighbour_names(rest.names[bone]) if name in rest.index]


def neighbour_names(name: str) -> list[str]:
    """Return the names of the other fingers or toes: LeftHandMiddle1 -> LeftHandRing1, ..."""
    for word in _FINGERS:
        for spelling in (str, str.capitalize, str.upper):
            if spelling(word) in name:
                return [name.replace(spelling(word), spelling(other)) for other in _FINGERS if other != word]
    for word, numbers in (("finger", "2345"), ("toe", "12345")):
        at = name.lower().find(word) + len(word)
        if at >= len(word) and name[at : at + 1] in tuple(numbers):
            return [name[:at] + number + name[at + 1 :] for number in numbers if number != name[at]]
    return []


def driven_ancestors(rest: ArmatureRest, order: Sequence[int], ancestors: IntArray | None) -> IntArray:
    """Return for each driven bone the index of the driven bone that it follows, or -1 if there is none."""
    place = {bone: index for index, bone in enumerate(order)}
    follows = np.where(rest.inherits_rotation, rest.parents, -1) if ancestors is None else ancestors
    found = []
    for bone in order:
        above = int(follows[bone])
        while above >= 0 and above not in place:
            above = int(follows[above])
        found.append(place.get(above, -1))
    return np.array(found, dtype=np.int64)
