"""Standard skeletons with the proportions of characters."""

from collections.abc import Mapping

import numpy as np

from ..body.skeleton import Skeleton
from ..body.source_motion import SourceMotion
from ..body.standard_skeleton import JOINT_NAMES, default_skeleton
from ..geometry import rotations as rot
from .armature_rest import ArmatureRest
from .character_fit import PLAIN_FIT, CharacterFit
from .character_rest_pose import align_character
from .to_standard_skeleton import to_standard_skeleton


def character_skeleton(
    name: str, rest: ArmatureRest, bones: Mapping[str, str], same_body: bool = False, fit: CharacterFit = PLAIN_FIT
) -> Skeleton:
    """Return the standard skeleton with a character's proportions; its legs have the default skeleton's length.

    Args:
        bones: Joint -> bone.
        same_body: The rest pose is the standard one.

    Raises:
        CharacterError: The rest pose is not usable.
    """
    default = default_skeleton()
    alignment = align_character(default, rest, {joint: rest.index[bone] for joint, bone in bones.items()}, fit=fit)
    scale = alignment.units_per_metre if not same_body else 1.0
    heads_m, turns = rest.heads @ alignment.armature_from_world / scale, {} if same_body else alignment.turns
    names = tuple(each for each in JOINT_NAMES if each in bones)
    parents, offsets_m = [], []
    for joint in names:
        above = int(default.parents[JOINT_NAMES.index(joint)])
        while above >= 0 and JOINT_NAMES[above] not in names:
            above = int(default.parents[above])
        parents.append(names.index(JOINT_NAMES[above]) if above >= 0 else -1)
        if above < 0:
            offsets_m.append(np.zeros(3))
            continue
        parent = JOINT_NAMES[above]
        way_m = heads_m[rest.index[bones[joint]]] - heads_m[rest.index[bones[parent]]]
        offsets_m.append(rot.rotate(turns.get(parent, rot.identity()), way_m))
    source = SourceMotion(
        name=name,
        where=name,
        fps=30.0,
        names=names,
        parents=np.array(parents),
        offsets_m=np.array(offsets_m),
        tips_m=np.zeros((len(names), 3)),
        rotations=rot.identity((1, len(names))),
        translations_m={0: np.zeros((1, 3))},
        euler_orders=("ZYX",) * len(names),
        metres_per_unit=1.0,
    )
    return to_standard_skeleton(source).skeleton
