"""Standard skeletons with the proportions of Blender's characters."""

import bpy
import numpy as np

from ...core.body.skeleton import Skeleton
from ...core.body.source_motion import SourceMotion
from ...core.body.standard_skeleton import JOINT_NAMES, default_skeleton
from ...core.geometry import rotations as rot
from ...core.retarget.character_rest_pose import align_character
from ...core.retarget.to_standard_skeleton import to_standard_skeleton
from ..character.armature_reading import read_armature_rest
from ..character.axes import BLENDER_FROM_WORLD
from ..character.bone_map_settings import stored_map
from ..character.create_character import joints_without_bone
from ..character.retarget_plans import bones_of


def own_skeleton(armature_object: bpy.types.Object) -> Skeleton:
    """Return the standard skeleton with a character's proportions; CharacterError without a bone map.

    A foreign character is scaled to a person's size: its legs get the default skeleton's length.
    """
    rest = read_armature_rest(armature_object)
    bones = bones_of(armature_object)
    default = default_skeleton()
    if not joints_without_bone(armature_object) and stored_map(armature_object) is None:
        heads_m = rest.heads @ BLENDER_FROM_WORLD
        turns = {}
    else:
        fit = align_character(default, rest, {joint: rest.index[bone] for joint, bone in bones.items()})
        heads_m, turns = fit.heads_m, fit.turns
    names = tuple(name for name in JOINT_NAMES if name in bones)
    parents, offsets_m = [], []
    for name in names:
        above = int(default.parents[JOINT_NAMES.index(name)])
        while above >= 0 and JOINT_NAMES[above] not in names:
            above = int(default.parents[above])
        parents.append(names.index(JOINT_NAMES[above]) if above >= 0 else -1)
        head_m = heads_m[rest.index[bones[name]]]
        if above < 0:
            offsets_m.append(np.zeros(3))
            continue
        parent = JOINT_NAMES[above]
        way_m = head_m - heads_m[rest.index[bones[parent]]]
        offsets_m.append(rot.rotate(turns.get(parent, rot.identity()), way_m))
    source = SourceMotion(
        name=armature_object.name,
        where=armature_object.name,
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
