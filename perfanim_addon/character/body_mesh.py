"""Body of a new character: the shipped mesh, fitted to a skeleton.

assets/character.npz holds one body in the rest pose of the default skeleton, made by tools/character_mesh.
"""

from dataclasses import dataclass
from functools import cache

import bpy
import numpy as np

from ...core.body.skeleton import Skeleton
from ...core.body.standard_skeleton import default_skeleton
from ...core.body.standing import girth_scale, standing_root_m
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array, IntArray
from ...core.system.assets import CHARACTER
from . import axes

_LEAST_WEIGHT = 0.002  # smaller shares are dropped: they cost time in every frame and move nothing visibly
_METRES_A_STEP = 1e-4
_SOLE_M = (0.03, 0.08)  # up to the first height a shoe is a part of the floor, from the second on of the foot

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
    """The mesh of a whole body in the rest pose, y up, z forward, soles at y = 0.

    Args:
        vertices_m: (V, 3).
        faces: (F, 4) counter-clockwise seen from outside.
        materials: (F,) index into `material_names`.
        material_names: names in the order of their indices.
        weights: (V, J) share of each joint, rows sum to one.
    """

    vertices_m: Array
    faces: IntArray
    materials: IntArray
    material_names: tuple[str, ...]
    weights: Array


@cache
def shipped_body() -> Body:
    """Return the body of the default skeleton."""
    with np.load(CHARACTER, allow_pickle=False) as arrays:
        weights = arrays["weights"].astype(np.float64)
        return Body(
            _METRES_A_STEP * arrays["vertices"].astype(np.float64),
            arrays["faces"].astype(np.int64),
            arrays["materials"].astype(np.int64),
            tuple(map(str, arrays["material_names"])),
            weights / weights.sum(axis=1, keepdims=True),
        )


def fitted_body(skeleton: Skeleton, heads_m: Array) -> Body:
    """Return the shipped body on another skeleton.

    Each bone carries its skin along: turned with the bone's rest direction, stretched along it by the bone's length and
    across it by the body's girth, blended by the skin weights. Soles stay on the floor.

    Args:
        heads_m: (J, 3) joints of the rest pose.
    """
    body, plain = shipped_body(), default_skeleton()
    girth = girth_scale(skeleton)
    maps = np.array([_bone_map(*tips_m, girth) for tips_m in zip(plain.tips_m, skeleton.tips_m, strict=True)])
    from_heads = body.vertices_m[:, None] - (plain.rest_positions_m + standing_root_m(plain))
    vertices = np.einsum("vj,jab,vjb->va", body.weights, maps, from_heads) + body.weights @ heads_m
    low, high = _SOLE_M
    floor = np.clip((high - body.vertices_m[:, 1]) / (high - low), 0.0, 1.0)
    vertices[:, 1] += floor * (girth * body.vertices_m[:, 1] - vertices[:, 1])
    return Body(vertices, body.faces, body.materials, body.material_names, body.weights)


def _bone_map(plain_tip_m: Array, tip_m: Array, girth: float) -> Array:
    """Return the linear map (3, 3) of the skin from the default skeleton's bone."""
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
    """Add the body as a mesh object that the armature deforms, and return it.

    Args:
        heads_m: (J, 3) joints of the armature's rest pose, product space.
    """
    body = fitted_body(skeleton, heads_m)
    mesh = bpy.data.meshes.new(armature_object.name + " body")
    mesh.from_pydata(axes.points_to_blender(body.vertices_m).tolist(), [], body.faces.tolist())
    for name in body.material_names:
        mesh.materials.append(_material(name))
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


def _add_groups(obj: bpy.types.Object, skeleton: Skeleton, weights: Array) -> None:
    kept = np.where(weights < _LEAST_WEIGHT, 0.0, weights)
    kept /= kept.sum(axis=1, keepdims=True)
    for joint, name in enumerate(skeleton.names):
        group = obj.vertex_groups.new(name=name)
        for vertex in np.flatnonzero(kept[:, joint]):
            group.add([int(vertex)], float(kept[vertex, joint]), "REPLACE")


def _material(name: str) -> bpy.types.Material:
    """Return the character material of that name, shared by all characters."""
    full_name = f"Performer {name}"
    found = bpy.data.materials.get(full_name)
    if found is not None:
        return found
    colour, roughness = _MATERIALS[name]
    material = new_material(full_name, colour, roughness)
    material.roughness = roughness
    return material


def new_material(name: str, colour: tuple[float, float, float], roughness: float) -> bpy.types.Material:
    """Return a new material of one colour, RGB, and roughness."""
    material = bpy.data.materials.new(name)
    ensure_nodes(material)
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = (*colour, 1.0)
    surface.inputs["Roughness"].default_value = roughness
    material.diffuse_color = (*colour, 1.0)  # solid viewport shading
    return material


def ensure_nodes(owner: bpy.types.Material | bpy.types.World) -> None:
    """Enable shader nodes of a material or world (always enabled from Blender 5.0)."""
    if bpy.app.version < (5, 0, 0):
        owner.use_nodes = True
