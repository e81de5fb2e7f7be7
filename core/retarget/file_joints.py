"""Joints of a motion file, found by their names and hierarchy."""

from functools import lru_cache

import numpy as np

from ..body.skeleton import zero_pose_positions
from ..body.source_motion import SourceMotion
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import SkeletonError
from .bone_name_parser import LIMB_WORDS, parse_bone_name
from .bone_tree import BoneTree
from .joint_matching import match_names, match_trunk

_NEEDED = ("root", "lfemur", "ltibia", "rfemur", "rtibia", "lhumerus", "lradius", "rhumerus", "rradius")


def match_joints(source: SourceMotion) -> dict[str, int]:
    """Return joint -> joint index in the file; SkeletonError if the hips or an arm or leg bone is missing."""
    if set(source.names) >= set(JOINT_NAMES):
        return {name: source.names.index(name) for name in JOINT_NAMES}
    try:
        return dict(_match(source.names, source.parents.tobytes(), source.offsets_m.tobytes()))
    except SkeletonError as error:
        raise SkeletonError(error.what, where=source.where, advice=error.advice) from None


@lru_cache(maxsize=64)  # clips of one data set share a skeleton
def _match(names: tuple[str, ...], parents: bytes, offsets_m: bytes) -> dict[str, int]:
    parent_of = np.frombuffer(parents, dtype=np.int64)
    offsets = np.frombuffer(offsets_m, dtype=np.float64).reshape(-1, 3)
    tree = BoneTree(names, parent_of, zero_pose_positions(parent_of, offsets))
    found, _ = match_names(tree)
    missing = [name for name in _NEEDED if name not in found]
    if missing and (sided := _with_sides(tree)) is not None:
        tree = sided
        found, _ = match_names(tree)
        missing = [name for name in _NEEDED if name not in found]
    repeated = [name for name in names if f"{name}_2" in names]
    if missing and repeated:
        advice = "name the sides: " + ", ".join(f"Left{name}, Right{name}" for name in repeated[:2])
        raise SkeletonError(f"two joints are called {repeated[-1]!r}, and their sides are not named", advice=advice)
    if missing:
        raise SkeletonError(
            "the file has no joint for " + ", ".join(missing), advice="rename its joints: " + ", ".join(names[:30])
        )
    if not match_trunk(tree, found):
        raise SkeletonError("its arms and legs have no common parent joint", advice="export the whole hierarchy")
    return {name: found[name] for name in JOINT_NAMES if name in found}


def _with_sides(tree: BoneTree) -> BoneTree | None:
    """Return the tree with sides in the names of paired joints, found from their positions; None if they are unclear.

    The toes point to the front.
    """
    pairs = [(tree.index[name], tree.index[f"{name}_2"]) for name in tree.names if f"{name}_2" in tree.index]
    toes = [pair for pair in pairs if parse_bone_name(tree.names[pair[0]]).words in LIMB_WORDS["toes"]]
    if not toes:
        return None
    front = np.sum([tree.heads[toe] - tree.heads[tree.parents[toe]] for toe in toes[0]], axis=0)
    left = np.cross((0.0, 1.0, 0.0), front)
    names = list(tree.names)
    for pair in pairs:
        below = ([bone for bone in range(len(tree)) if tree.is_above(joint, bone)] for joint in pair)
        sides = [float(np.mean(tree.heads[bones] @ left)) for bones in below]
        if not np.any(left) or min(sides) >= 0.0 or max(sides) <= 0.0:
            return None
        for joint, side in zip(pair, sides, strict=True):
            names[joint] = f"{'Left' if side > 0.0 else 'Right'}{tree.names[pair[0]]}"
    return BoneTree(tuple(names), tree.parents, tree.heads)
