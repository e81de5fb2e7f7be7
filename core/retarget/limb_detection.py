"""Detection of an armature's limbs by its shape: two symmetric pairs of chains."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..errors import CharacterError
from ..geometry.arrays import Array
from .armature_rest import ArmatureRest
from .bone_name_parser import parse_bone_name

Pair = tuple[list[int], list[int]]


@dataclass(frozen=True)
class LimbSettings:
    """Proportions used to recognise limbs."""

    shortest_limb: float = 0.2  # smallest length of a limb, fraction of the armature's greatest extent
    unequal: float = 0.15  # largest relative difference in length of the chains of a pair
    apart: float = 0.05  # smallest distance between the ends of a pair, fraction of the greatest extent
    short_bone: float = 0.12  # fraction of a limb's length below which bones at its start belong to pelvis or shoulder
    foot_cosine: float = np.cos(np.radians(35.0))  # largest cosine between leg and foot
    upright_cosine: float = np.cos(np.radians(50.0))  # smallest cosine between trunk and legs


_SETTINGS = LimbSettings()


@dataclass(frozen=True)
class Limbs:
    """Chains of leg and arm bones from the trunk outwards, by side."""

    legs: dict[str, list[int]]
    arms: dict[str, list[int]]


def find_limbs(rest: ArmatureRest) -> Limbs | None:
    """Return the limbs of a biped's armature, or None if it does not have two pairs."""
    pairs = _pairs(rest)
    best: tuple[float, Pair, Pair] | None = None
    for legs, arms in ((a, b) for one, other in combinations(pairs[:4], 2) for a, b in ((one, other), (other, one))):
        score = _uprightness(rest, legs, arms)
        if set(legs[0]) & set(arms[0]) or set(legs[0]) & set(arms[1]):
            continue
        if best is None or score > best[0]:
            best = (score, legs, arms)
    if best is None:
        return None
    score, legs, arms = best
    check_upright(score)
    left = _left(rest, legs, arms)
    return Limbs(_by_side(rest, legs, left), _by_side(rest, arms, left))


def _pairs(rest: ArmatureRest) -> list[Pair]:
    """Return pairs of similar chains with a common parent bone, longest first."""
    size = float(np.max(np.ptp(rest.heads, axis=0)))
    reach = np.zeros(len(rest))
    for bone in range(len(rest) - 1, 0, -1):
        parent = int(rest.parents[bone])
        if parent >= 0:
            step = float(np.linalg.norm(rest.heads[bone] - rest.heads[parent]))
            reach[parent] = max(reach[parent], step + reach[bone])
    found = []
    for children in rest.children:
        for a, b in combinations(children, 2):
            longer = max(reach[a], reach[b])
            if longer < _SETTINGS.shortest_limb * size or abs(reach[a] - reach[b]) > _SETTINGS.unequal * longer:
                continue
            chains = _main_chain(rest, a, reach), _main_chain(rest, b, reach)
            apart = float(np.linalg.norm(rest.heads[chains[0][-1]] - rest.heads[chains[1][-1]]))
            if apart > _SETTINGS.apart * size and min(len(chains[0]), len(chains[1])) >= 2:
                found.append((longer, chains))
    return [chains for _, chains in sorted(found, key=lambda item: -item[0])]


def _main_chain(rest: ArmatureRest, bone: int, reach: Array) -> list[int]:
    """Return the longest chain outwards from a bone, up to a hand with fingers."""
    chain = [bone]
    while True:
        children = [child for child in rest.children[chain[-1]] if not parse_bone_name(rest.names[child]).helper]
        if not children or (len(chain) >= 3 and len(children) >= 3):
            return chain
        step = [float(np.linalg.norm(rest.heads[c] - rest.heads[chain[-1]])) + float(reach[c]) for c in children]
        chain.append(children[int(np.argmax(step))])


def _uprightness(rest: ArmatureRest, legs: Pair, arms: Pair) -> float:
    """Return the mean cosine between the legs and the line from legs to arms."""
    hips, shoulders = (np.mean([rest.heads[chain[0]] for chain in pair], axis=0) for pair in (legs, arms))
    ways = [rest.heads[chain[0]] - rest.heads[chain[-1]] for chain in legs]
    return float(np.mean([cosine(way, shoulders - hips) for way in ways]))


def check_upright(score: float) -> None:
    """Raise CharacterError unless the trunk continues the line of the legs.

    Args:
        score: Cosine of the angle between trunk and legs.
    """
    if score < _SETTINGS.upright_cosine:
        angle = np.degrees(np.arccos(np.clip(score, -1.0, 1.0)))
        raise CharacterError(
            f"the armature is not a biped: its trunk leans {angle:.0f} degrees from its legs, like a quadruped's",
            advice="choose a character that stands on two legs in its rest pose",
        )


def cosine(a: Array, b: Array) -> float:
    """Return the cosine of the angle between two vectors; 0 if one of them is zero."""
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0.0 else 0.0


def _left(rest: ArmatureRest, legs: Pair, arms: Pair) -> Array:
    """Return the direction to the character's left, from names or otherwise from the feet."""
    across = np.zeros(3)
    for a, b in (legs, arms):
        way = rest.heads[a[-1]] - rest.heads[b[-1]]
        sides = [parse_bone_name(rest.names[chain[-1]]).side for chain in (a, b)]
        across += way * (1.0 if sides == ["l", "r"] else -1.0 if sides == ["r", "l"] else 0.0)
    if np.any(across):
        return across
    hips, shoulders = (np.mean([rest.heads[chain[0]] for chain in pair], axis=0) for pair in (legs, arms))
    forward = np.sum([rest.heads[chain[-1]] - rest.heads[chain[-2]] for chain in legs], axis=0)
    return np.cross(shoulders - hips, forward)


def _by_side(rest: ArmatureRest, pair: Pair, left: Array) -> dict[str, list[int]]:
    a, b = pair
    if float((rest.heads[a[-1]] - rest.heads[b[-1]]) @ left) < 0.0:
        a, b = b, a
    return {"l": a, "r": b}


def leg_joints(rest: ArmatureRest, chain: list[int]) -> dict[str, int]:
    """Return femur, tibia, foot and toes of a leg's chain, as far as the chain has them."""
    chain = _without_short_start(rest, chain)
    down = rest.heads[chain[-1]] - rest.heads[chain[0]]
    ankle = _evenly_bent(rest, chain)
    for place in range(2, len(chain) - 1):  # the first bone after the knee that points forwards
        if cosine(rest.heads[chain[place + 1]] - rest.heads[chain[place]], down) < _SETTINGS.foot_cosine:
            ankle = place
            break
    names = {"femur": chain[0]}
    if ankle >= 2:
        names |= {"tibia": _middle(rest, chain[: ankle + 1]), "foot": chain[ankle]}
    elif len(chain) == 2:
        names["tibia"] = chain[1]
    if ankle + 1 < len(chain) and "foot" in names:
        names["toes"] = chain[ankle + 1]
    return names


def _evenly_bent(rest: ArmatureRest, chain: list[int]) -> int:
    """Return the index of the ankle in the chain: the bone with a knee halfway above it."""
    way = rest.distances(chain)
    uneven = {place: float(np.min(np.abs(way[1:place] / way[place] - 0.5))) for place in range(2, len(chain))}
    return min(uneven, key=lambda place: uneven[place], default=len(chain) - 1)


def arm_joints(rest: ArmatureRest, chain: list[int]) -> dict[str, int]:
    """Return clavicle, humerus, radius and hand of an arm's chain."""
    rest_of_arm = _without_short_start(rest, chain) if len(chain) > 3 else chain
    names = {"clavicle": chain[0]} if rest_of_arm[0] != chain[0] else {}
    if not names and len(chain) >= 4:
        names, rest_of_arm = {"clavicle": chain[0]}, chain[1:]
    names["humerus"] = rest_of_arm[0]
    if len(rest_of_arm) >= 3:
        names |= {"radius": _middle(rest, rest_of_arm), "hand": rest_of_arm[-1]}
    elif len(rest_of_arm) == 2:
        names["radius"] = rest_of_arm[1]
    return names


def _without_short_start(rest: ArmatureRest, chain: list[int]) -> list[int]:
    steps = np.linalg.norm(np.diff(rest.heads[chain], axis=0), axis=1)
    start = 0
    while start < len(steps) - 2 and steps[start] < _SETTINGS.short_bone * float(steps.sum()):
        start += 1
    return chain[start:]


def _middle(rest: ArmatureRest, chain: list[int]) -> int:
    """Return the bone nearest to the middle of the chain: knee or elbow."""
    way = rest.distances(chain)
    return chain[1 + int(np.argmin(np.abs(way[1:-1] - 0.5 * way[-1])))]
