"""Skin of a character's feet, read from its meshes."""

from collections.abc import Mapping

import bpy
import numpy as np

from ...core.geometry.arrays import Array
from ...core.retarget.armature_rest import ArmatureRest
from ...core.retarget.character_fit import SkinPoints
from ...core.retarget.driven_bones import neighbours

_SAME_HEAD = (
    0.01  # largest distance, as a fraction of the body's extent, of the heads of bones that stand for each other
)
_REACH = 0.3  # largest distance of a foot's skin from the ankle, as a fraction of the body's extent
# bones that move with the foot, those of them that move with the toes, and those that move with the shank alone
_Names = tuple[set[str], set[str], set[str]]
_MOST = 0.5  # share of a vertex's weights above which it belongs to the foot, or to the shank


def foot_skins(
    armature_object: bpy.types.Object, rest: ArmatureRest, bones: Mapping[str, str]
) -> dict[str, SkinPoints]:
    """Return side -> points of the foot's mesh; a side without a mesh is left out.

    Args:
        rest: Rest pose of the armature.
        bones: Joint -> bone.
    """
    meshes = [each for each in bpy.data.objects if each.type == "MESH" and each.find_armature() == armature_object]
    found = {}
    for side in "lr":
        if side + "foot" not in bones:
            continue
        ankle = rest.index[bones[side + "foot"]]
        foot = _followers(rest, ankle)
        balls = [rest.index[bones[side + "toes"]]] if side + "toes" in bones else []
        toes = set().union(*(_followers(rest, toe) for ball in balls for toe in (ball, *neighbours(rest, ball))))
        shank = _followers(rest, rest.index[bones[side + "tibia"]]) - foot if side + "tibia" in bones else set()
        near = rest.heads[ankle], _REACH * float(np.ptp(rest.heads, axis=0).max())
        skins = [_skin(armature_object, mesh, near, (foot, toes, shank)) for mesh in meshes]
        if any(len(skin.points) for skin in skins):
            parts = ([getattr(skin, part) for skin in skins] for part in ("points", "toe_weights", "shank"))
            found[side] = SkinPoints(*map(np.concatenate, parts))
    return found


def _followers(rest: ArmatureRest, bone: int) -> set[str]:
    """Return the bones that move with a bone: those below it, and below others with its head, as in control rigs."""
    close = _SAME_HEAD * float(np.ptp(rest.heads, axis=0).max())
    tops = np.flatnonzero(np.linalg.norm(rest.heads - rest.heads[bone], axis=1) < close)
    along = rest.tails - rest.heads
    same = {bone, *(int(top) for top in tops if along[top] @ along[bone] > 0.0 and rest.deform[top])}
    return {name for index, name in enumerate(rest.names) if same & set(rest.line(index))}


def _skin(
    armature_object: bpy.types.Object, mesh_object: bpy.types.Object, near: tuple[Array, float], names: _Names
) -> SkinPoints:
    """Return the points of a mesh that belong to a foot."""
    foot, toes, shank = ({group.index for group in mesh_object.vertex_groups if group.name in each} for each in names)
    vertices = mesh_object.data.vertices
    places = np.empty(3 * len(vertices), dtype=np.float32)
    vertices.foreach_get("co", places)
    to_armature = np.array(armature_object.matrix_world.inverted() @ mesh_object.matrix_world)
    points = places.reshape(-1, 3) @ to_armature[:3, :3].T + to_armature[:3, 3]
    ankle, reach = near
    rows, shares, above = [], [], []
    for row in np.flatnonzero(np.linalg.norm(points - ankle, axis=1) < reach) if foot else ():
        weights = [(group.group, group.weight) for group in vertices[int(row)].groups]
        least = _MOST * sum(weight for _, weight in weights)
        own = sum(weight for group, weight in weights if group in foot)
        if own > least:
            rows.append(row)
            shares.append(sum(weight for group, weight in weights if group in toes) / own)
        elif sum(weight for group, weight in weights if group in shank) > least:
            above.append(row)
    return SkinPoints(points[rows].reshape(-1, 3), np.array(shares, dtype=np.float64), points[above].reshape(-1, 3))
