"""Joint map of a motion file, by names and hierarchy."""

from ..body.skeleton import zero_pose_positions
from ..body.source_motion import SourceMotion
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import SkeletonError
from .bone_tree import BoneTree
from .joint_matching import match_names, match_trunk

_NEEDED = ("root", "lfemur", "ltibia", "rfemur", "rtibia", "lhumerus", "lradius", "rhumerus", "rradius")


def match_joints(source: SourceMotion) -> dict[str, int]:
    """Return joint -> joint index in the file, without the joints that it lacks.

    Raises:
        SkeletonError: the hips or a thigh, shank, upper arm or forearm is missing.
    """
    if set(source.names) >= set(JOINT_NAMES):
        return {name: source.names.index(name) for name in JOINT_NAMES}
    tree = BoneTree(source.names, source.parents, zero_pose_positions(source.parents, source.offsets_m))
    found, _ = match_names(tree)
    missing = [name for name in _NEEDED if name not in found]
    if missing:
        raise SkeletonError(
            "no joint of the file is the " + ", ".join(missing),
            where=source.where,
            advice="joints of the file: " + ", ".join(source.names[:30]),
        )
    if not match_trunk(tree, found):
        raise SkeletonError("its arms and legs have no common parent joint", where=source.where)
    return {name: found[name] for name in JOINT_NAMES if name in found}
