"""Smooth closed surfaces: implicit lofts, their blended union, and a quadrilateral mesh.

A shape is described by its thickness along an axis; shapes are united with a rounded seam. A surface net (Gibson 1998,
"Constrained elastic surface nets") meshes the zero level: one vertex per grid cell on the surface, then relaxed on the
surface so that the quadrilaterals are even. Pure numpy.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Field = Callable[[Array], Array]

_CORNERS = np.array(list(product((0, 1), repeat=3)))


@dataclass(frozen=True)
class Loft:
    """A body of K superelliptic cross-sections along a straight axis, with rounded ends; metres."""

    start: ArrayLike  # (3,) ends of the axis
    end: ArrayLike
    at: Sequence[float]  # positions of the sections, as fractions of the axis (beyond 0 and 1 allowed), ascending
    widths: Sequence[float]  # half widths along `across`
    depths: Sequence[float] = ()  # half depths along axis x across; by default the widths (round sections)
    shifts: Sequence[float] = ()  # section centres along axis x across
    across: ArrayLike = (0.0, 0.0, 1.0)  # direction of the widths; made perpendicular to the axis
    caps: tuple[float, ...] = (0.01, 0.01)  # lengths of the rounded ends
    power: float = 2.0  # 2 gives ellipses, larger values give boxes with rounded corners
    blend: float = 0.03  # radius of the rounded seam with the shapes before it

    def __call__(self, points: Array) -> Array:
        """Return signed distances of points (..., 3), accurate only near the surface."""
        start = np.asarray(self.start, dtype=np.float64)
        axis = np.asarray(self.end, dtype=np.float64) - start
        length = float(np.linalg.norm(axis))
        axis = axis / length
        across = np.asarray(self.across, dtype=np.float64)
        across = across - (across @ axis) * axis
        across /= np.linalg.norm(across)
        local = (points - start) @ np.stack((across, np.cross(axis, across), axis), axis=1)
        knots = np.asarray(self.at) * length
        along = np.clip(local[..., 2], knots[0], knots[-1])
        width = np.interp(along, knots, self.widths)
        depth = np.interp(along, knots, self.depths) if self.depths else width
        shift = np.interp(along, knots, self.shifts) if self.shifts else 0.0
        beyond = (local[..., 2] - along) / np.where(local[..., 2] < along, self.caps[0], self.caps[1])
        ratios = np.stack((local[..., 0] / width, (local[..., 1] - shift) / depth, beyond), axis=-1)
        radius = np.sum(np.abs(ratios) ** self.power, axis=-1) ** (1.0 / self.power)
        return (radius - 1.0) * np.minimum(width, depth)


def ball(centre: ArrayLike, radii: Sequence[float], *, blend: float = 0.03) -> Loft:
    """Return an ellipsoid with its axes along the world's."""
    middle = np.asarray(centre, dtype=np.float64)
    sliver = 1e-3 * radii[1]
    up = np.array([0.0, sliver, 0.0])
    return Loft(
        middle - up, middle + up, (0.0, 1.0), (radii[0],) * 2, (radii[2],) * 2, across=(1.0, 0.0, 0.0),
        caps=(radii[1] - sliver, radii[1] - sliver), blend=blend,
    )  # fmt: skip


def union(shapes: Sequence[Loft]) -> Field:
    """Return the field of all shapes, each joined with its own `blend` radius."""

    def field(points: Array) -> Array:
        result = shapes[0](points)
        for shape in shapes[1:]:
            other = shape(points)
            overlap = np.maximum(shape.blend - np.abs(result - other), 0.0) / shape.blend
            result = np.minimum(result, other) - 0.25 * shape.blend * overlap**2
        return result

    return field


def mesh_of(field: Field, low: Array, high: Array, spacing: float) -> tuple[Array, IntArray]:
    """Return the mesh of a field's zero level: vertices (V, 3) and quadrilaterals (F, 4).

    The mesh is symmetric in x if field and box are. Quadrilaterals are counter-clockwise seen from outside.

    Args:
        low, high: Corners of the box (3,), metres; the surface must not touch its sides.
        spacing: Size of the quadrilaterals, metres.
    """
    counts = np.ceil((high - low) / spacing).astype(np.int64) + 1
    axes = [0.5 * (low[i] + high[i]) + spacing * (np.arange(counts[i]) - 0.5 * (counts[i] - 1)) for i in range(3)]
    values = field(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    vertices, faces = _surface_net(values)
    vertices = vertices * spacing + np.array([axis[0] for axis in axes])
    return _relaxed(field, vertices, faces, spacing), faces


def _surface_net(values: Array) -> tuple[Array, IntArray]:
    inside = values < 0.0
    cells = np.array(values.shape) - 1
    corners = [inside[tuple(slice(c, c + n) for c, n in zip(corner, cells, strict=True))] for corner in _CORNERS]
    filled = np.sum(corners, axis=0)
    where = np.argwhere((filled > 0) & (filled < 8))
    numbers = np.full(tuple(cells), -1, dtype=np.int64)
    numbers[tuple(where.T)] = np.arange(len(where))
    return where + _crossings_mean(values, where), _faces(inside, numbers)


def _crossings_mean(values: Array, where: IntArray) -> Array:
    """Return the mean points (V, 3) of the cells' edge crossings, in cell units."""
    at_corners = np.stack([values[tuple((where + corner).T)] for corner in _CORNERS], axis=1)
    total, count = np.zeros((len(where), 3)), np.zeros(len(where))
    for a, b in product(range(8), repeat=2):
        if a >= b or np.sum(np.abs(_CORNERS[a] - _CORNERS[b])) != 1:
            continue
        first, second = at_corners[:, a], at_corners[:, b]
        crosses = (first < 0.0) != (second < 0.0)
        fraction = np.where(crosses, first / np.where(crosses, first - second, 1.0), 0.0)
        total += crosses[:, None] * (_CORNERS[a] + fraction[:, None] * (_CORNERS[b] - _CORNERS[a]))
        count += crosses
    return total / count[:, None]


def _faces(inside: NDArray[np.bool_], numbers: IntArray) -> IntArray:
    """Return a quadrilateral of the four cells around each edge that crosses the surface."""
    faces = []
    for axis in range(3):
        u, v = np.eye(3, dtype=np.int64)[[(axis + 1) % 3, (axis + 2) % 3]]
        here = np.moveaxis(inside, axis, 0)
        start, end = np.moveaxis(here[:-1], 0, axis), np.moveaxis(here[1:], 0, axis)
        for leaving, around in (
            (start & ~end, (-u - v, -v, np.zeros(3, dtype=np.int64), -u)),
            (~start & end, (-u - v, -u, np.zeros(3, dtype=np.int64), -v)),
        ):
            edges = np.argwhere(leaving)
            faces.append(np.stack([numbers[tuple((edges + step).T)] for step in around], axis=1))
    return np.concatenate(faces)


def _relaxed(field: Field, vertices: Array, faces: IntArray, spacing: float, rounds: int = 8) -> Array:
    """Move vertices towards their neighbours' mean and back onto the surface."""
    neighbours = np.concatenate([faces[:, [i, (i + 1) % 4]] for i in range(4)])
    neighbours = np.unique(np.sort(neighbours, axis=1), axis=0)
    both = np.concatenate((neighbours, neighbours[:, ::-1]))
    degree = np.bincount(both[:, 0], minlength=len(vertices))[:, None]
    for _ in range(rounds):
        total = np.zeros_like(vertices)
        np.add.at(total, both[:, 0], vertices[both[:, 1]])
        vertices = vertices + 0.5 * (total / degree - vertices)
        for _ in range(2):
            vertices = vertices - _step_to_surface(field, vertices, spacing)
    return vertices


def _step_to_surface(field: Field, points: Array, spacing: float) -> Array:
    """Return the Newton step to the zero level, limited to half the spacing."""
    value, width = field(points), 0.05 * spacing
    gradient = np.stack(
        [(field(points + step) - field(points - step)) / (2.0 * width) for step in width * np.eye(3)], axis=-1
    )
    step = value[:, None] * gradient / np.maximum(np.sum(gradient**2, axis=-1, keepdims=True), 1e-4)
    length = np.linalg.norm(step, axis=-1, keepdims=True)
    return step * np.minimum(1.0, 0.5 * spacing / np.maximum(length, 1e-12))
