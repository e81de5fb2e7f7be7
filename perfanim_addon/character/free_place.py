"""Where a new character stands in the scene, and a view that shows it."""

from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Vector

from ...core.geometry.arrays import Array

_PLACES_M = (0.0, 2.5, -2.5, 5.0, -5.0)  # along X, tried in this order
_REACH_M = 0.5  # of a standing performer to each side
_HEIGHT_M = 1.9
_LOW_M = 0.3  # what rises no higher does not hide a character: floors, mats
_SOLID = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
_VIEW_HEIGHT_M = 0.95
_VIEW_DISTANCE_M = 7.0  # a performer who walks to and fro stays in the picture


def find_free_position(context: bpy.types.Context) -> Vector:
    """Return the free position nearest to the scene's origin."""
    boxes = list(_boxes(context))
    for x in _PLACES_M:
        low, high = np.array([x - _REACH_M, -_REACH_M, _LOW_M]), np.array([x + _REACH_M, _REACH_M, _HEIGHT_M])
        if not any(np.all(bottom < high) and np.all(top > low) for bottom, top in boxes):
            return Vector((x, 0.0, 0.0))
    return Vector()


def _boxes(context: bpy.types.Context) -> Iterator[tuple[Array, Array]]:
    """Yield lowest and highest world corners of each visible solid object."""
    context.view_layer.update()
    for obj in context.view_layer.objects:
        if obj.type in _SOLID and obj.visible_get():
            corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
            yield corners.min(axis=0), corners.max(axis=0)


def look_at(context: bpy.types.Context, place: Vector) -> None:
    """Centre the clicked 3D view on a place, unless it looks through a camera."""
    area = context.area
    if area is None or area.type != "VIEW_3D":
        return
    view = area.spaces.active.region_3d
    if view.view_perspective != "CAMERA" and not view.lock_rotation:
        view.view_location = place + Vector((0.0, 0.0, _VIEW_HEIGHT_M))
        view.view_distance = _VIEW_DISTANCE_M
