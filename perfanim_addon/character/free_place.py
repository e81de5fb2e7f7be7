"""Free position for a new character in the scene, and a view that shows it."""

from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ...core.geometry.arrays import Array

_SOLID = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


@dataclass(frozen=True)
class StandingPlace:
    """Sizes in the scene, chosen by eye."""

    places_m: tuple[float, ...] = (0.0, 2.5, -2.5, 5.0, -5.0)  # positions along X, tried in this order
    reach_m: float = 0.5  # half the width of a standing performer
    height_m: float = 1.9  # height of a standing performer
    low_m: float = 0.3  # height of floors and mats, which do not hide a character
    view_height_m: float = 0.95  # height of the view's centre
    view_distance_m: float = 7.0  # distance of the viewpoint: a performer who walks back and forth stays visible


_PLACE = StandingPlace()


def find_free_position(context: bpy.types.Context) -> Vector:
    """Return the free position nearest to the scene's origin."""
    boxes, reach = list(_boxes(context)), _PLACE.reach_m
    for x in _PLACE.places_m:
        low, high = np.array([x - reach, -reach, _PLACE.low_m]), np.array([x + reach, reach, _PLACE.height_m])
        if not any(np.all(bottom < high) and np.all(top > low) for bottom, top in boxes):
            return Vector((x, 0.0, 0.0))
    return Vector()


def _boxes(context: bpy.types.Context) -> Iterator[tuple[Array, Array]]:
    """Yield the lowest and highest corner in the world of each visible solid object."""
    context.view_layer.update()
    for obj in context.view_layer.objects:
        if obj.type in _SOLID and obj.visible_get():
            corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
            yield corners.min(axis=0), corners.max(axis=0)


def look_at(context: bpy.types.Context, place: Vector) -> None:
    """Centre the clicked 3D view on a position, unless it looks through a camera."""
    area = context.area
    if area is None or area.type != "VIEW_3D":
        return
    view = area.spaces.active.region_3d
    if view.view_perspective != "CAMERA" and not view.lock_rotation:
        view.view_location = place + Vector((0.0, 0.0, _PLACE.view_height_m))
        view.view_distance = _PLACE.view_distance_m
