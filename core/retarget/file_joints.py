"""Joint map of a motion file, by names and hierarchy.

Names are cut into words (CamelCase, separators), prefixes of rigs dropped, and the side found among the words. Limbs
go by their words; the joints of the trunk and the neck go by their place between the pelvis, the arms and the head,
because files have any number of them.
"""

import re
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ..body.source_motion import SourceMotion, zero_pose_positions
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import SkeletonError
from ..geometry.arrays import Array, IntArray

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_PREFIX = re.compile(r"(?i)^(character|bip)\d*[ _]")
_DROPPED = frozenset(("mixamorig", "bip", "j", "c", "def", "org", "jnt", "bone", "joint", "skeleton", "biped"))
_SIDES = {"left": "l", "l": "l", "right": "r", "r": "r"}

# words of a limb's joint, the likeliest first; the first that a file has is taken, each joint of a file once
_LIMBS: dict[str, tuple[str, ...]] = {
    "femur": ("femur", "upleg", "upperleg", "thigh", "uplegs", "hip", "hipjoint"),
    "tibia": ("tibia", "lowleg", "lowerleg", "leg", "shin", "calf", "knee", "shank"),
    "foot": ("foot", "ankle", "feet"),
    "toes": ("toes", "toe", "toebase", "toe0", "ball", "toe1", "forefoot"),
    "humerus": ("humerus", "upperarm", "uparm", "arm", "shldr", "bicep", "shoulder"),
    "clavicle": ("clavicle", "collar", "collarbone", "shoulder", "clav"),
    "radius": ("radius", "lowerarm", "lowarm", "forearm", "fore arm", "elbow"),
    "hand": ("hand", "wrist", "palm"),
    "wrist": ("wrist",),
    "fingers": (
        "fingers", "fingerbase", "handmiddle1", "middle1", "middleproximal", "middle01", "finger2", "handindex1",
        "index1", "indexproximal", "index01", "finger1",
    ),
    "thumb": ("thumb", "handthumb1", "thumb1", "thumbproximal", "thumbmetacarpal", "thumb01", "finger0"),
}  # fmt: skip
_ROOTS = ("hips", "pelvis", "hip", "root", "spinebase", "lowertorso", "abdomen")
_HEADS = ("head", "skull")
_NECKS = ("neck", "lowerneck", "upperneck", "cervical")
_NEEDED = ("root", "lfemur", "ltibia", "rfemur", "rtibia", "lhumerus", "lradius", "rhumerus", "rradius")
_TRUNK_SHARES = {"lowerback": 0.0, "upperback": 0.5, "thorax": 1.0}  # of the way from the hips to the thorax
_NECK_CHAIN = ("lowerneck", "upperneck")


def match_joints(source: SourceMotion) -> dict[str, int]:
    """Return joint -> joint index in the file, without the joints that it lacks.

    Raises:
        SkeletonError: the hips or a thigh, shank, upper arm or forearm is missing.
    """
    if set(source.names) >= set(JOINT_NAMES):
        return {name: source.names.index(name) for name in JOINT_NAMES}
    sided, middle = _by_words(source.names)
    found: dict[str, int] = {}
    for side in "lr":
        taken: set[int] = set()
        for joint, words in _LIMBS.items():
            index = next((sided[side, w] for w in words if (side, w) in sided and sided[side, w] not in taken), None)
            if index is not None and not (joint == "wrist" and side + "hand" not in found):
                found[side + joint] = index
                taken.add(index)
    for name, words in (("root", _ROOTS), ("head", _HEADS)):
        index = next((middle[word] for word in words if word in middle), None)
        if index is not None:
            found[name] = index
    missing = [name for name in _NEEDED if name not in found]
    if missing:
        raise SkeletonError(
            "no joint of the file is the " + ", ".join(missing),
            where=source.where,
            advice="joints of the file: " + ", ".join(source.names[:30]),
        )
    _match_trunk(source, found, middle)
    return {name: found[name] for name in JOINT_NAMES if name in found}


def _by_words(names: Sequence[str]) -> tuple[dict[tuple[str, str], int], dict[str, int]]:
    """Return joints by (side, words), and those of the middle by words."""
    sided: dict[tuple[str, str], int] = {}
    middle: dict[str, int] = {}
    for index, name in enumerate(names):
        side, words = split_name(name)
        if side:
            sided.setdefault((side, words), index)
        else:
            middle.setdefault(words, index)
    return sided, middle


@lru_cache(maxsize=4096)  # files of one data set share their names
def split_name(name: str) -> tuple[str, str]:
    """Return side and joined words: "mixamorig:LeftUpLeg" -> ("l", "upleg")."""
    bare = _PREFIX.sub("", re.split(r"[:|]", name)[-1])
    words = [word.lower() for word in _WORDS.findall(bare)]
    side = next((_SIDES[word] for word in words if word in _SIDES), "")
    rest = [word for word in words if word not in _SIDES and word not in _DROPPED]
    joined = "".join(rest)
    known = {word for aliases in _LIMBS.values() for word in aliases}
    if not side and joined[:1] in ("l", "r") and joined[1:] in known:
        return joined[0], joined[1:]  # CMU and Poser: lfemur, rShldr
    return side, joined or "root" * ("joint" in words or "root" in words)


def _ancestors(parents: IntArray, joint: int) -> list[int]:
    """Return the joints above one, nearest first."""
    chain = []
    while parents[joint] >= 0:
        joint = int(parents[joint])
        chain.append(joint)
    return chain


def _match_trunk(source: SourceMotion, found: dict[str, int], middle: dict[str, int]) -> None:
    root = found["root"]
    arms = [found.get(side + "clavicle", found[side + "humerus"]) for side in "lr"]
    above = [_ancestors(source.parents, arm) for arm in arms]
    shared = [joint for joint in above[0] if joint in above[1]]
    if root not in shared:
        raise SkeletonError("its arms do not hang on its hips", where=source.where)
    trunk = shared[: shared.index(root)][::-1]  # from the hips up
    positions = zero_pose_positions(source.parents, source.offsets_m)
    if trunk:
        found["thorax"] = trunk[-1]
        shares = _shares(positions, [root, *trunk])
        found |= _assign(("lowerback", "upperback"), trunk[:-1], shares[:-1], _TRUNK_SHARES)
    top = trunk[-1] if trunk else root
    if "head" not in found:
        return
    neck = [joint for joint in _ancestors(source.parents, found["head"]) if top in _ancestors(source.parents, joint)]
    neck = neck[::-1]
    if len(neck) <= len(_NECK_CHAIN):
        found |= dict(zip(_NECK_CHAIN, neck, strict=False))
    else:
        found |= {"lowerneck": neck[0], "upperneck": neck[-1]}


def _shares(positions: Array, chain: list[int]) -> list[float]:
    """Return how far along the chain its joints but the first lie, 0 to 1."""
    steps = np.linalg.norm(np.diff(positions[chain], axis=0), axis=1)
    length = max(float(steps.sum()), 1e-9)
    return [float(value) / length for value in np.cumsum(steps)]


def _assign(names: Sequence[str], joints: list[int], shares: list[float], wanted: dict[str, float]) -> dict[str, int]:
    """Return the ordered assignment with the least distance along the chain."""
    if len(joints) >= len(names):
        picks = [(i, j) for i in range(len(joints)) for j in range(i + 1, len(joints))]
        best = min(picks, key=lambda p: sum(abs(shares[i] - wanted[n]) for i, n in zip(p, names, strict=True)))
        return {name: joints[i] for name, i in zip(names, best, strict=True)}
    if not joints:
        return {}
    nearest = min(names, key=lambda name: abs(shares[0] - wanted[name]))
    return {nearest: joints[0]}
