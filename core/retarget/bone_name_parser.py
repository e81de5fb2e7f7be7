"""Parser for bone names: side, words and numbers in the spelling of any rig.

It understands Mixamo, Rigify (metarig, deform bones), MakeHuman and MPFB, Unreal, VRM and VRoid, Rokoko, the CMU
database, 3ds Max Biped, Valve, DAZ, Poser and most rigs with English names.
"""

import re
from dataclasses import dataclass
from functools import lru_cache

from ..body.standard_skeleton import JOINT_NAMES, TABLES, facts_of

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_SIDES = {"left": "l", "l": "l", "lft": "l", "right": "r", "r": "r", "rgt": "r"}
_DROPPED, _HELPERS = frozenset(TABLES["dropped"]), frozenset(TABLES["helpers"])

# joint of a limb -> words in its names, the likeliest first
LIMB_WORDS = {joint: tuple(row["words"]) for joint, row in TABLES["joint"].items() if joint not in JOINT_NAMES}
HIPS_WORDS, HEAD_WORDS = (tuple(facts_of(joint)["words"]) for joint in ("root", "head"))


@dataclass(frozen=True)
class BoneName:
    """Parsed name of a bone.

    Args:
        side: "l", "r", or "" for the middle.
        words: Words that describe the joint, joined in lower case.
        numbers: Numbers in the name in order, without the number in the prefix "Bip01".
        helper: Whether the bone only supports another one (twist, IK target, ...).
    """

    side: str
    words: str
    numbers: tuple[int, ...]
    helper: bool


@lru_cache(maxsize=8192)
def parse_bone_name(name: str) -> BoneName:
    """Parse a bone's name: "mixamorig:LeftUpLeg" -> left, "upleg"."""
    words = [word.lower() for word in _WORDS.findall(re.split(r"[:|]", name)[-1])]
    numbers = tuple(
        int(word[:9]) for before, word in zip(["", *words], words, strict=False) if word.isdecimal() and before != "bip"
    )
    sides = [_SIDES[word] for word in words if word in _SIDES]
    said = [word for word in words if word not in _SIDES and word not in _DROPPED and not word.isdecimal()]
    joined = "".join(said)
    known = {word for aliases in LIMB_WORDS.values() for word in aliases}
    if not sides and joined[:1] in ("l", "r") and joined[1:] in known:  # CMU and Poser: lfemur, rshldr
        sides, joined = [joined[0]], joined[1:]
    joined = joined or "root" * ("joint" in words)
    return BoneName(sides[0] if sides else "", joined, numbers, any(word in _HELPERS for word in words))
