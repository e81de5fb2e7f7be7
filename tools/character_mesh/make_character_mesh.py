"""Make the mesh of the extension's character.

python -m character_mesh.make_character_mesh OUT.npz  # in tools/
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from perfanim.core.body.body_size import standing_root_m
from perfanim.core.body.standard_skeleton import default_skeleton

from .shapes import Figure, Part, parts_of
from .skin_weights import eased, skin_weights
from .surface import Array, IntArray, mesh_of, union

MATERIAL_NAMES = ("shirt", "trousers", "skin", "hair", "shoe", "eye")
_MATERIAL_OF = {"clothes": "shirt", "head": "skin", "hand": "skin", "hair": "hair", "shoe": "shoe", "eye": "eye"}
_COVERED_BY = {"head": "hair", "hair": "head"}  # in every pose, because both move as one
_HIDDEN_M = 0.006
_THUMB = 5  # index of the thumb among a hand's shapes
_WEIGHT_STEPS = 4095  # integer that the file stores for a weight of one


def write_character(path: Path) -> None:
    """Write the body of the default skeleton in the product's axes and rest pose."""
    skeleton = default_skeleton()
    figure = Figure(skeleton, skeleton.rest_positions_m + standing_root_m(skeleton))
    parts = parts_of(figure)
    meshes = [_mesh(part, parts, figure) for part in parts]
    starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in meshes)])
    names = np.concatenate([np.full(len(mesh[0]), part.name) for part, mesh in zip(parts, meshes, strict=True)])
    thumbs = np.concatenate([_thumb_share(part, mesh[0]) for part, mesh in zip(parts, meshes, strict=True)])
    vertices = np.concatenate([vertices for vertices, _, _ in meshes])
    faces = np.concatenate([own + start for (_, own, _), start in zip(meshes, starts[:-1], strict=True)])
    weights = skin_weights(figure, vertices, names, thumbs)
    np.savez_compressed(
        path,
        vertices=np.round(1e4 * vertices).astype(np.int16),
        faces=faces.astype(np.uint16),
        materials=np.concatenate([materials for _, _, materials in meshes]).astype(np.uint8),
        weights=np.round(_WEIGHT_STEPS * weights).astype(np.uint16),
        joints=np.array(skeleton.names),
        material_names=np.array(MATERIAL_NAMES),
    )


def _mesh(part: Part, parts: list[Part], figure: Figure) -> tuple[Array, IntArray, IntArray]:
    """Return vertices (V, 3), faces (F, 4), materials (F,) of a part, without what another part always hides."""
    ends = np.concatenate([np.stack((shape.start, shape.end)) for shape in part.shapes])
    margin = max(max(shape.widths) for shape in part.shapes) + 2.5 * part.spacing_m + 0.02
    field = union(part.shapes)
    vertices, faces = mesh_of(field, ends.min(axis=0) - margin, ends.max(axis=0) + margin, part.spacing_m)
    materials = _materials(part, figure, vertices, faces)
    inside = np.zeros(len(vertices), dtype=bool)
    for other in parts:
        if other.name == _COVERED_BY.get(part.name):
            inside |= union(other.shapes)(vertices) < -_HIDDEN_M * figure.scale
    kept = ~np.all(inside[faces], axis=1)
    used, renumbered = np.unique(faces[kept], return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 4), materials[kept]


def _materials(part: Part, figure: Figure, vertices: Array, faces: IntArray) -> NDArray[np.int64]:
    """Return the faces' materials; shirt and trousers meet at the belt, to which vertices are moved."""
    result = np.full(len(faces), MATERIAL_NAMES.index(_MATERIAL_OF[part.name]))
    if part.name == "clothes":
        belt_m = figure.off(figure.joint("lowerback"), 0.0, 0.050, 0.0)[1]
        below = vertices[faces].mean(axis=1)[:, 1] < belt_m
        result[below] = MATERIAL_NAMES.index("trousers")
        vertices[np.intersect1d(faces[~below], faces[below]), 1] = belt_m
    return result


def _thumb_share(part: Part, vertices: Array) -> Array:
    """Return to what degree each vertex belongs to a thumb, 0 to 1."""
    if part.name != "hand":
        return np.zeros(len(vertices))
    others = union([shape for place, shape in enumerate(part.shapes) if place != _THUMB])
    return eased((others(vertices) - part.shapes[_THUMB](vertices)) / 0.012)


if __name__ == "__main__":
    write_character(Path(sys.argv[1]))
