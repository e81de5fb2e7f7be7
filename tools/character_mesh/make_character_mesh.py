"""Make the mesh of the extension's character.

python -m character_mesh.make_character_mesh OUT.npz  # in tools/
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.body.standing import standing_root_m

from .shapes import Figure, Part, parts_of
from .skin_weights import skin_weights
from .surface import Array, Field, mesh_of, union

MATERIAL_NAMES = ("shirt", "trousers", "skin", "hair", "shoe", "eye")
WEIGHT_STEPS = 4095  # a weight of one, as the file stores it
_COVERED = {("head", "hair"), ("hair", "head")}  # (part, what covers it in every pose: both move as one)
_HIDDEN_M = 0.006
_THUMB = 5  # place of the thumb among a hand's shapes
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


def make_body(skeleton: Skeleton, heads_m: Array) -> Body:
    """Return the body of a skeleton with rest joints at `heads_m` (J, 3)."""
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
    """Remove surface well inside another part, such as the skull under the hair.

    It would only cost drawing time.
    """
    inside = np.zeros(len(vertices), dtype=bool)
    for field in others:
        inside |= field(vertices) < -_HIDDEN_M * scale
    kept = ~np.all(inside[faces], axis=1)
    used, renumbered = np.unique(faces[kept], return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 4), kept


def _belt_m(figure: Figure) -> float:
    return float(figure.off(figure.joint("lowerback"), 0.0, 0.050, 0.0)[1])


def _straighten(vertices: Array, faces: NDArray[np.int64], materials: NDArray[np.int64], figure: Figure) -> None:
    """Move the vertices between shirt and trousers onto the belt's height.

    So they meet in a clean line.
    """
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


def write_character(path: Path) -> Body:
    """Write the body of the default skeleton; return it."""
    skeleton = default_skeleton()
    body = make_body(skeleton, skeleton.rest_positions_m + standing_root_m(skeleton))
    np.savez_compressed(
        path,
        vertices=np.round(1e4 * body.vertices_m).astype(np.int16),
        faces=body.faces.astype(np.uint16),
        materials=body.materials.astype(np.uint8),
        weights=np.round(WEIGHT_STEPS * body.weights).astype(np.uint16),
        joints=np.array(skeleton.names),
        material_names=np.array(MATERIAL_NAMES),
    )
    return body


if __name__ == "__main__":
    write_character(Path(sys.argv[1]))
