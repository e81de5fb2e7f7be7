"""Matching bones to joints of the standard skeleton, by names and hierarchy.

Limbs are found by the words in their names. Trunk and neck are found by their position between hips, arms and head,
because rigs and files have any number of bones there.
"""

from collections.abc import Sequence
from itertools import pairwise

from .bone_name_parser import HEAD_WORDS, HIPS_WORDS, LIMB_WORDS, parse_bone_name
from .bone_tree import BoneTree

_LIMBS = {"leg": ("femur", "tibia", "foot"), "arm": ("humerus", "radius")}  # joints of a complete limb
_TRUNK_SHARES = {"lowerback": 0.0, "upperback": 0.5}  # position between hips (0) and thorax (1)
_AMBIGUOUS_ROOTS = ("root", "cog", "torso")  # names that may mean the hips, or a bone above them


def match_names(tree: BoneTree) -> tuple[dict[str, int], dict[str, bool]]:
    """Return joint -> bone, found by names, and limb ("lleg", ...) -> whether it is complete."""
    named = _NamedBones(tree)
    found: dict[str, int] = {} if named.hips < 0 else {"root": named.hips}
    complete = {}
    for side in "lr":
        limb = _limbs(named, side) | _numbered_fingers(tree, side)
        for name, chain in _LIMBS.items():
            given = all(joint in limb for joint in chain)
            complete[side + name] = given and all(tree.is_above(limb[a], limb[b]) for a, b in pairwise(chain))
        found |= {side + joint: bone for joint, bone in limb.items()}
    head = named.first(HEAD_WORDS, "", set())
    return found | ({"head": head} if head >= 0 else {}), complete


class _NamedBones:
    """The bones of a tree by the words in their names."""

    def __init__(self, tree: BoneTree) -> None:
        self._tree = tree
        self._parsed = parsed = [parse_bone_name(name) for name in tree.names]
        self._depth = [len(tree.line(bone)) for bone in range(len(tree))]
        self._used = [bone for bone in range(len(tree)) if not parsed[bone].helper]
        self.hips = min(
            (bone for bone in self._used if not parsed[bone].side and parsed[bone].words in HIPS_WORDS),
            key=lambda bone: (HIPS_WORDS.index(parsed[bone].words), self._depth[bone]),
            default=-1,
        )
        top = tree.line(self.hips)[-1] if self.hips >= 0 else -1
        self._below = [self.hips < 0 or tree.is_above(top, bone) for bone in range(len(tree))]

    def first(self, words: Sequence[str], side: str, taken: set[int]) -> int:
        """Return the likeliest bone of a side that has one of the words as its name and is not taken; -1 for none."""
        parsed, parents = self._parsed, self._tree.parents
        candidates = [b for b in self._used if parsed[b].side == side and parsed[b].words in words and b not in taken]
        # a bone whose child has the same joint word (LHipJoint above LeftHip) is only the socket and does not rotate
        above = {b: int(parents[b]) for b in candidates if parents[b] >= 0}
        sockets = {parent for b, parent in above.items() if parsed[parent] == parsed[b]}
        return min(
            (b for b in candidates if b not in sockets),
            key=lambda b: (words.index(parsed[b].words), not self._below[b], self._depth[b], parsed[b].numbers, b),
            default=-1,
        )


def _limbs(named: _NamedBones, side: str) -> dict[str, int]:
    """Return joint -> bone of the limbs of one side."""
    taken: set[int] = set()
    limb: dict[str, int] = {}
    for joint, words in LIMB_WORDS.items():
        bone = named.first(words, side, taken)
        if bone >= 0 and not (joint == "wrist" and named.first(("hand",), side, taken) < 0):
            limb[joint] = bone
            taken.add(bone)
    if "humerus" not in limb and "clavicle" in limb:  # a single bone called shoulder is the upper arm
        limb["humerus"] = limb.pop("clavicle")
    return limb


def _numbered_fingers(tree: BoneTree, side: str) -> dict[str, int]:
    """Return thumb and middle finger among numbered fingers: finger3-1, Finger2."""
    bases: dict[int, int] = {}
    for bone, name in enumerate(tree.names):
        parsed = parse_bone_name(name)
        if parsed.side == side and parsed.words == "finger" and parsed.numbers:
            bases.setdefault(parsed.numbers[0], bone)
    order = sorted(bases)
    if len(order) == 5:
        return {"thumb": bases[order[0]], "fingers": bases[order[2]]}
    return {"thumb": bases[0], "fingers": bases[min(order[-1], 2)]} if {0, 1} <= bases.keys() else {}


def match_trunk(tree: BoneTree, found: dict[str, int]) -> bool:
    """Add root, back, neck and head from the hierarchy; return False if the limbs have no common ancestor."""
    arms = [found.get(side + "clavicle", found[side + "humerus"]) for side in "lr"]
    limbs = [found["lfemur"], found["rfemur"], *arms]
    root = found.get("root", -1)
    is_ambiguous = root >= 0 and parse_bone_name(tree.names[root]).words in _AMBIGUOUS_ROOTS
    if root < 0 or is_ambiguous or not all(tree.is_above(root, bone) for bone in limbs):
        root = tree.shared_ancestor(limbs)
    if root < 0:
        return False
    found["root"] = root
    trunk = tree.path(root, tree.shared_ancestor(arms))[1:]
    if trunk:
        found["thorax"] = trunk[-1]
        found |= _match_back(tree, [root, *trunk])
    top = found.get("thorax", root)
    if "head" not in found or not tree.is_above(top, found["head"]):
        found.pop("head", None)
        head = _topmost(tree, top, arms)
        found |= {"head": head} if head >= 0 else {}
    neck = tree.path(top, found["head"])[1:-1] if "head" in found else []
    if neck:
        found |= {"lowerneck": neck[0]} | ({"upperneck": neck[-1]} if len(neck) > 1 else {})
    return True


def _match_back(tree: BoneTree, trunk: list[int]) -> dict[str, int]:
    """Return the bones nearest to the starts of lower and upper back."""
    way = tree.distances(trunk)
    shares = dict(zip(trunk, way / max(float(way[-1]), 1e-9), strict=True))
    free = trunk[1:-1]
    if len(free) == 1:
        return {min(_TRUNK_SHARES, key=lambda joint: abs(shares[free[0]] - _TRUNK_SHARES[joint])): free[0]}
    found: dict[str, int] = {}
    for joint, share in _TRUNK_SHARES.items():
        if free:
            found[joint] = min(free, key=lambda bone: abs(shares[bone] - share))
            free = free[free.index(found[joint]) + 1 :]
    return found


def _topmost(tree: BoneTree, top: int, arms: list[int]) -> int:
    """Return the last bone of the chain upwards between the arms, or -1 if there is none."""
    parsed = [parse_bone_name(name) for name in tree.names]
    bone, found = top, -1
    while True:
        children = [
            child
            for child in tree.children[bone]
            if not parsed[child].side
            and not parsed[child].helper
            and not any(tree.is_above(child, arm) for arm in arms)
        ]
        named = [child for child in children if parsed[child].words in ("spine", "neck", *HEAD_WORDS)]
        if not children or (found >= 0 and not named and len(children) != 1):
            return found
        if found >= 0 and not named and parsed[found].words in ("spine", *HEAD_WORDS):
            return found  # what follows are bones of the face
        bone = found = (named or children)[0]
