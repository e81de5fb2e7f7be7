"""Parser of bone names: side, words and numbers in any rig's spelling.

Covers the names of Mixamo, Rigify (metarig, deform bones), MakeHuman and MPFB, Unreal, VRM and VRoid, Rokoko, the CMU
database, 3ds Max Biped, Valve, DAZ, Poser and most rigs that are named in English.
"""

import re
from dataclasses import dataclass
from functools import lru_cache

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_SIDES = {"left": "l", "l": "l", "lft": "l", "right": "r", "r": "r", "rgt": "r"}
_DROPPED = frozenset(
    (
        "mixamorig", "bip", "biped", "valve", "character", "skeleton", "armature", "rig", "j", "c", "b", "def", "jnt",
        "joint", "bone", "sk", "bend", "fk", "ctrl", "m",
    )
)  # fmt: skip
# bones with these words only help others along
_HELPERS = frozenset(
    (
        "twist", "roll", "helper", "ik", "pole", "target", "end", "nub", "tip", "eff", "effector", "breast", "eye",
        "ear", "weapon", "prop", "socket", "attach", "mch", "org", "wgt", "tweak", "parent", "control", "orient",
        "pivot", "spin", "heel", "tracker", "buttock", "twister", "share", "aux", "ribbon", "stretch", "site",
    )
)  # fmt: skip

# words of a limb's joint, the likeliest first
LIMB_WORDS: dict[str, tuple[str, ...]] = {
    "femur": ("femur", "upleg", "upperleg", "thigh", "uleg", "legupper", "hip"),
    "tibia": ("tibia", "lowleg", "lowerleg", "shin", "calf", "leglower", "leg", "knee", "shank"),
    "foot": ("foot", "ankle", "feet"),
    "toes": ("toes", "toe", "toebase", "ball", "bigtoe", "forefoot"),
    "clavicle": ("clavicle", "collar", "collarbone", "shoulder", "clav", "scapula"),
    "humerus": ("humerus", "upperarm", "uparm", "uarm", "armupper", "arm", "shldr", "bicep", "shoulder"),
    "radius": ("radius", "lowerarm", "lowarm", "forearm", "farm", "armlower", "elbow"),
    "wrist": ("wrist",),
    "hand": ("hand", "wrist", "palm"),
    "fingers": (
        "fingers", "fingerbase", "handmiddle", "middle", "middleproximal", "fmiddle", "middlefinger", "handindex",
        "index", "indexproximal", "findex", "indexfinger", "finger",
    ),
    "thumb": ("thumb", "handthumb", "thumbproximal", "thumbmetacarpal"),
}  # fmt: skip
HIPS_WORDS = ("hips", "pelvis", "hip", "root", "spinebase", "lowertorso", "midhip", "cog", "torso", "abdomen")
HEAD_WORDS = ("head", "skull")


@dataclass(frozen=True)
class BoneName:
    """Parsed name of a bone.

    Args:
        side: "l", "r", or "" for the middle.
        words: the words that tell the joint, run together in lower case.
        numbers: the numbers in the name but those of a prefix (Bip01), in order.
        helper: the words tell that the bone only helps another one along.
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
        int(word) for before, word in zip(["", *words], words, strict=False) if word.isdigit() and before != "bip"
    )
    sides = [_SIDES[word] for word in words if word in _SIDES]
    said = [word for word in words if word not in _SIDES and word not in _DROPPED and not word.isdigit()]
    joined = "".join(said)
    known = {word for aliases in LIMB_WORDS.values() for word in aliases}
    if not sides and joined[:1] in ("l", "r") and joined[1:] in known:  # CMU and Poser: lfemur, rshldr
        sides, joined = [joined[0]], joined[1:]
    joined = joined or "root" * ("joint" in words)
    return BoneName(sides[0] if sides else "", joined, numbers, any(word in _HELPERS for word in words))
