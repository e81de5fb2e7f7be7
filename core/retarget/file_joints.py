"""Joints of a motion file, found by names and hierarchy."""

from functools import lru_cache

import numpy as np

from ..body.skeleton import zero_pose_positions
from ..body.source_motion import SourceMotion
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import SkeletonError
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


@lru_cache(maxsize=64)  # clips of one data set share their skeleton
def _match(names: tuple[str, ...], parents: bytes, offsets_m: bytes) -> dict[str, int]:
    parent_of = np.frombuffer(parents, dtype=np.int64)
    offsets = np.frombuffer(offsets_m, dtype=np.float64).reshape(-1, 3)
    tree = BoneTree(names, parent_of, zero_pose_positions(parent_of, offsets))
    found, _ = match_names(tree)
    missing = [name for name in _NEEDED if name not in found]
    if missing:
        raise SkeletonError(
            "no joint of the file is the " + ", ".join(missing), advice="joints of the file: " + ", ".join(names[:30])
        )
    if not match_trunk(tree, found):
        raise SkeletonError("its arms and legs have no common parent joint")
    return {name: found[name] for name in JOINT_NAMES if name in found}
