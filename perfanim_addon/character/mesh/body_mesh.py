"""The body of a new character as a Blender mesh: surfaces, materials and vertex groups."""

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ....core.body.skeleton import Skeleton
from .. import axes
from .shapes import Figure, Part, parts_of
from .skin_weights import skin_weights
from .surface import Array, Field, mesh_of, union

_LEAST_WEIGHT = 0.002  # smaller shares are dropped: they cost time in every frame and move nothing visibly
_COVERED = {("head", "hair"), ("hair", "head")}  # (part, what covers it in every pose: both move as one)
_HIDDEN_M = 0.006
_THUMB = 5  # place of the thumb among a hand's shapes
_KEPT_BODIES = 4

# name: (linear RGB, roughness)
_MATERIALS: dict[str, tuple[tuple[float, float, float], float]] = {
    "shirt": ((0.030, 0.190, 0.290), 0.75),
    "trousers": ((0.042, 0.050, 0.070), 0.80),
    "skin": ((0.560, 0.300, 0.190), 0.50),
    "hair": ((0.055, 0.030, 0.020), 0.60),
    "shoe": ((0.500, 0.480, 0.450), 0.55),
    "eye": ((0.015, 0.015, 0.018), 0.20),
}
_OF_PART = {"clothes": "shirt", "head": "skin", "hand": "skin", "hair": "hair", "shoe": "shoe", "eye": "eye"}


@dataclass(frozen=True)
class Body:
    """The mesh of a whole body in product space, rest pose.

    Args:
        vertices_m: (V, 3).
        faces: (F, 4) counter-clockwise seen from outside.
        materials: (F,) index into `MATERIAL_NAMES`.
        weights: (V, J) share of each joint, rows sum to one.
    """

    vertices_m: Array
    faces: NDArray[np.int64]
    materials: NDArray[np.int64]
    weights: Array


MATERIAL_NAMES = tuple(_MATERIALS)

_bodies: dict[tuple[bytes, ...], Body] = {}


def make_body(skeleton: Skeleton, heads_m: Array) -> Body:
    """Return the body for a skeleton whose joints stand at `heads_m` (J, 3) in the rest pose."""
    figure = Figure(skeleton, heads_m)
    parts = parts_of(figure)
    fields = [union(part.shapes) for part in parts]
    vertices, faces, materials, thumbs, names = [], [], [], [], []
    count = 0
    for part in parts:
        own_vertices, own_faces = _surface(part)
        own_materials = _material_of(part, figure, own_vertices[own_faces].mean(axis=1))
        _straighten(own_vertices, own_faces, own_materials, figure)
        others = [field for other, field in zip(parts, fields, strict=True) if (part.name, other.name) in _COVERED]
        own_vertices, own_faces, kept = _without_hidden(own_vertices, own_faces, others, figure.scale)
        vertices.append(own_vertices)
        faces.append(own_faces + count)
        materials.append(own_materials[kept])
        thumbs.append(_thumb_share(part, own_vertices))
        names += [part.name] * len(own_vertices)
        count += len(own_vertices)
    points = np.concatenate(vertices)
    weights = skin_weights(skeleton, figure, points, np.array(names), np.concatenate(thumbs))
    return Body(points, np.concatenate(faces), np.concatenate(materials), weights)


def _surface(part: Part) -> tuple[Array, NDArray[np.int64]]:
    ends = np.concatenate([np.stack((shape.start, shape.end)) for shape in part.shapes])
    margin = max(max(shape.widths) for shape in part.shapes) + 2.5 * part.spacing_m + 0.02
    return mesh_of(union(part.shapes), ends.min(axis=0) - margin, ends.max(axis=0) + margin, part.spacing_m)


def _without_hidden(
    vertices: Array, faces: NDArray[np.int64], others: list[Field], scale: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """Leave out what lies well inside another part (the skull under the hair): it would only cost time to draw."""
    inside = np.zeros(len(vertices), dtype=bool)
    for field in others:
        inside |= field(vertices) < -_HIDDEN_M * scale
    kept = ~np.all(inside[faces], axis=1)
    used, renumbered = np.unique(faces[kept], return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 4), kept


def _belt_m(figure: Figure) -> float:
    return float(figure.off(figure.joint("lowerback"), 0.0, 0.050, 0.0)[1])


def _straighten(vertices: Array, faces: NDArray[np.int64], materials: NDArray[np.int64], figure: Figure) -> None:
    """Move the vertices between shirt and trousers onto the belt's height, so that they meet in a clean line."""
    above, below = MATERIAL_NAMES.index("shirt"), MATERIAL_NAMES.index("trousers")
    border = np.intersect1d(faces[materials == above], faces[materials == below])
    vertices[border, 1] = _belt_m(figure)


def _material_of(part: Part, figure: Figure, centres: Array) -> NDArray[np.int64]:
    result = np.full(len(centres), MATERIAL_NAMES.index(_OF_PART[part.name]))
    if part.name == "clothes":
        result[centres[:, 1] < _belt_m(figure)] = MATERIAL_NAMES.index("trousers")
    return result


def _thumb_share(part: Part, vertices: Array) -> Array:
    if part.name != "hand":
        return np.zeros(len(vertices))
    others = union([shape for place, shape in enumerate(part.shapes) if place != _THUMB])
    nearer = (others(vertices) - part.shapes[_THUMB](vertices)) / 0.012
    t = np.clip(0.5 + 0.5 * nearer, 0.0, 1.0)
    share: Array = t * t * (3.0 - 2.0 * t)
    return share


def add_body(
    context: bpy.types.Context, skeleton: Skeleton, heads_m: Array, armature_object: bpy.types.Object
) -> bpy.types.Object:
    """Add the body as a mesh object that the armature deforms, and return it.

    Args:
        heads_m: (J, 3) joints of the armature's rest pose, product space.
    """
    body = _body(skeleton, heads_m)
    mesh = bpy.data.meshes.new(armature_object.name + " body")
    mesh.from_pydata(axes.points_to_blender(body.vertices_m).tolist(), [], body.faces.tolist())
    for name in MATERIAL_NAMES:
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


def _body(skeleton: Skeleton, heads_m: Array) -> Body:
    """Return the body of `make_body`, which takes a second, but for one that was made lately."""
    key = (skeleton.offsets_m.tobytes(), skeleton.tips_m.tobytes(), heads_m.tobytes())
    if key not in _bodies:
        if len(_bodies) >= _KEPT_BODIES:
            _bodies.clear()
        _bodies[key] = make_body(skeleton, heads_m)
    return _bodies[key]


def _add_groups(obj: bpy.types.Object, skeleton: Skeleton, weights: Array) -> None:
    kept = np.where(weights < _LEAST_WEIGHT, 0.0, weights)
    kept /= kept.sum(axis=1, keepdims=True)
    for joint, name in enumerate(skeleton.names):
        group = obj.vertex_groups.new(name=name)
        for vertex in np.flatnonzero(kept[:, joint]):
            group.add([int(vertex)], float(kept[vertex, joint]), "REPLACE")


def _material(name: str) -> bpy.types.Material:
    """Return the character material of that name, shared by all characters of the file."""
    full_name = f"Performer {name}"
    found = bpy.data.materials.get(full_name)
    if found is not None:
        return found
    colour, roughness = _MATERIALS[name]
    material = bpy.data.materials.new(full_name)
    ensure_nodes(material)
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = (*colour, 1.0)
    surface.inputs["Roughness"].default_value = roughness
    material.diffuse_color = (*colour, 1.0)  # solid viewport shading
    material.roughness = roughness
    return material


def ensure_nodes(owner: bpy.types.Material | bpy.types.World) -> None:
    """Give a material or world its shader nodes; from Blender 5.0 on it always has them, and asking is deprecated."""
    if bpy.app.version < (5, 0, 0):
        owner.use_nodes = True
