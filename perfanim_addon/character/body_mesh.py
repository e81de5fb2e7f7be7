"""Body of a new character: the shipped mesh, fitted to a skeleton.

assets/character.npz holds one body in the rest pose of the default skeleton, made by tools/character_mesh.
"""

from dataclasses import dataclass
from functools import cache

import bpy
import numpy as np

from ...core.body.body_size import girth_scale, standing_root_m
from ...core.body.skeleton import Skeleton
from ...core.body.soles import upright_foot
from ...core.body.standard_skeleton import default_skeleton
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array, IntArray
from ...core.retarget.displayed_joint_names import BLENDER, naming_of
from ...core.system.assets import CHARACTER
from ..blender_versions import enable_nodes
from . import axes

_METRES_PER_STEP = 1e-4  # resolution of the stored coordinates


@dataclass(frozen=True)
class BodyFit:
    """Tuned numbers of the fit, chosen by eye."""

    least_weight: float = 0.002  # smaller skin weights are dropped: they cost time in every frame and show nothing
    sole_m: float = 0.03  # height up to which a shoe stays on the floor
    foot_m: float = 0.08  # height above which a shoe moves only with the foot


_FIT = BodyFit()

# name: (linear RGB, roughness)
_MATERIALS: dict[str, tuple[tuple[float, float, float], float]] = {
    "shirt": ((0.030, 0.190, 0.290), 0.75),
    "trousers": ((0.042, 0.050, 0.070), 0.80),
    "skin": ((0.560, 0.300, 0.190), 0.50),
    "hair": ((0.055, 0.030, 0.020), 0.60),
    "shoe": ((0.500, 0.480, 0.450), 0.55),
    "eye": ((0.015, 0.015, 0.018), 0.20),
}


@dataclass(frozen=True)
class Body:
    """Mesh of a whole body in the rest pose, y up, z forward, soles at y = 0."""

    vertices_m: Array  # vertices (V, 3)
    faces: IntArray  # vertices (F, 4) of each face, counter-clockwise seen from outside
    materials: IntArray  # index (F,) into `material_names`
    material_names: tuple[str, ...]
    weights: Array  # skin weights (V, J); rows sum to one


@cache
def shipped_body() -> Body:
    """Return the body of the default skeleton."""
    with np.load(CHARACTER, allow_pickle=False) as arrays:
        weights = arrays["weights"].astype(np.float64)
        return Body(
            _METRES_PER_STEP * arrays["vertices"].astype(np.float64),
            arrays["faces"].astype(np.int64),
            arrays["materials"].astype(np.int64),
            tuple(map(str, arrays["material_names"])),
            weights / weights.sum(axis=1, keepdims=True),
        )


def fitted_body(skeleton: Skeleton, heads_m: Array) -> Body:
    """Return the shipped body on another skeleton.

    The skin of each bone is rotated with the bone's rest direction, scaled along the bone by its length and across it
    by the body's girth, and blended by the skin weights. The soles are flat when the legs are upright; in the rest
    pose, whose legs are spread, the feet are tilted like the legs.

    Args:
        skeleton: Skeleton of the new body.
        heads_m: Joint positions (J, 3) of the armature in the rest pose.
    """
    body, plain = shipped_body(), default_skeleton()
    girth = girth_scale(skeleton)
    maps = np.array([_bone_map(*tips_m, girth) for tips_m in zip(plain.tips_m, skeleton.tips_m, strict=True)])
    from_heads = body.vertices_m[:, None] - (plain.rest_positions_m + standing_root_m(plain))
    vertices = np.einsum("vj,jab,vjb->va", body.weights, maps, from_heads) + body.weights @ heads_m
    floor = np.clip((_FIT.foot_m - body.vertices_m[:, 1]) / (_FIT.foot_m - _FIT.sole_m), 0.0, 1.0)
    vertices[:, 1] += floor * (girth * body.vertices_m[:, 1] - vertices[:, 1])
    for side in "lr":
        share = body.weights[:, [skeleton.index(side + name) for name in ("foot", "toes")]].sum(axis=1, keepdims=True)
        vertices += share * (_tilted_foot(skeleton, heads_m, side, vertices) - vertices)
    return Body(vertices, body.faces, body.materials, body.material_names, body.weights)


def _tilted_foot(skeleton: Skeleton, heads_m: Array, side: str, flat_m: Array) -> Array:
    """Return points (V, 3) of a flat foot, tilted about the ankle so that the foot of an upright leg is flat."""
    ankle, ball = (heads_m[skeleton.index(side + name)] for name in ("foot", "toes"))
    upright, level = upright_foot(skeleton, side), np.array([1.0, 0.0, 1.0])
    to_ball = rot.rotate(upright, ball - ankle)
    turned = rot.rotate(rot.between((ball - ankle) * level, to_ball * level), flat_m - ankle)
    turned[:, 1] += to_ball[1] - (ball - ankle)[1]
    return ankle + rot.rotate(rot.conjugate(upright), turned)


def _bone_map(plain_tip_m: Array, tip_m: Array, girth: float) -> Array:
    """Return the linear map (3, 3) from the skin of the default skeleton's bone to that of the new one."""
    before, after = np.linalg.norm(plain_tip_m), np.linalg.norm(tip_m)
    if min(before, after) < 1e-6:
        return girth * np.eye(3)
    along = plain_tip_m / before
    stretch = girth * np.eye(3) + (after / before - girth) * np.outer(along, along)
    turn: Array = rot.to_matrix(rot.between(plain_tip_m, tip_m)) @ stretch
    return turn


def add_body(
    context: bpy.types.Context, skeleton: Skeleton, heads_m: Array, armature_object: bpy.types.Object
) -> bpy.types.Object:
    """Add the body as a mesh object that the armature deforms; return it. Arguments as in `fitted_body`."""
    body = fitted_body(skeleton, heads_m)
    mesh = bpy.data.meshes.new(armature_object.name + " body")
    mesh.from_pydata(axes.points_to_blender(body.vertices_m).tolist(), [], body.faces.tolist())
    for name in body.material_names:
        mesh.materials.append(character_material(name))
    mesh.polygons.foreach_set("material_index", body.materials.astype(np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(body.faces), dtype=bool))
    mesh.update()
    obj = bpy.data.objects.new(mesh.name, mesh)
    (context.collection or context.scene.collection).objects.link(obj)
    obj.parent = armature_object
    modifier = obj.modifiers.new("Armature", "ARMATURE")
    modifier.object = armature_object
    _add_groups(obj, skeleton, body.weights)
    return obj


def remove_body(armature_object: bpy.types.Object) -> None:
    """Remove the body of a character that was deleted: Blender deletes what is selected, but not its children."""
    for child in armature_object.children:
        if child.name == armature_object.name + " body":
            bpy.data.objects.remove(child)


def _add_groups(obj: bpy.types.Object, skeleton: Skeleton, weights: Array) -> None:
    kept = np.where(weights < _FIT.least_weight, 0.0, weights)
    kept /= kept.sum(axis=1, keepdims=True)
    for joint, name in enumerate(skeleton.names):
        group = obj.vertex_groups.new(name=naming_of(BLENDER)[name])
        for vertex in np.flatnonzero(kept[:, joint]):
            group.add([int(vertex)], float(kept[vertex, joint]), "REPLACE")


def character_material(name: str) -> bpy.types.Material:
    """Return the character material with a name, shared by all characters."""
    full_name = f"Performer {name}"
    return bpy.data.materials.get(full_name) or new_material(full_name, *_MATERIALS[name])


def new_material(name: str, colour: tuple[float, float, float], roughness: float) -> bpy.types.Material:
    """Return a new material with one colour, linear RGB, and a roughness."""
    material = bpy.data.materials.new(name)
    enable_nodes(material)
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = (*colour, 1.0)
    surface.inputs["Roughness"].default_value = roughness
    material.diffuse_color, material.roughness = (*colour, 1.0), roughness  # for solid viewport shading
    return material
