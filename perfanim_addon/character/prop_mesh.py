"""Placeholder object for a prop: a shaft, arms to the markers, and balls as markers."""

from dataclasses import dataclass

import bmesh
import bpy
from mathutils import Matrix, Vector

from ...core.markers.prop import Prop
from .axes import points_to_blender


@dataclass(frozen=True)
class PropShape:
    """Sizes of the placeholder in metres, chosen by eye."""

    sides: int = 8  # number of faces around shaft, arms and balls
    shaft_m: float = 0.012  # radius
    arm_m: float = 0.005  # radius
    marker_m: float = 0.016  # radius
    on_shaft_m: float = 0.03  # distance from the axis up to which a marker needs no arm


_SHAPE = PropShape()


def add_prop_object(context: bpy.types.Context, prop: Prop) -> bpy.types.Object:
    """Add and return a mesh of a prop at the scene's origin, with its y along Z."""
    places = [Vector(place) for place in points_to_blender(prop.positions_m)]
    shape = bmesh.new()
    low, high = (each(place.z for place in places) for each in (min, max))
    _add_rod(shape, Vector((0.0, 0.0, low)), Vector((0.0, 0.0, high)), _SHAPE.shaft_m)
    for place in places:
        foot = Vector((0.0, 0.0, place.z))
        if (place - foot).length > _SHAPE.on_shaft_m:
            _add_rod(shape, foot, place, _SHAPE.arm_m)
        rings = {"u_segments": _SHAPE.sides, "v_segments": _SHAPE.sides // 2}
        bmesh.ops.create_uvsphere(shape, **rings, radius=_SHAPE.marker_m, matrix=Matrix.Translation(place))
    mesh = bpy.data.meshes.new(prop.name)
    shape.to_mesh(mesh)
    shape.free()
    made = bpy.data.objects.new(prop.name, mesh)
    made.rotation_mode = "QUATERNION"
    (context.collection or context.scene.collection).objects.link(made)
    return made


def _add_rod(shape: bmesh.types.BMesh, start: Vector, end: Vector, radius: float) -> None:
    along = end - start
    middle = Matrix.Translation(0.5 * (start + end)) @ along.to_track_quat("Z", "Y").to_matrix().to_4x4()
    ends = {"radius1": radius, "radius2": radius, "depth": along.length}
    bmesh.ops.create_cone(shape, cap_ends=True, segments=_SHAPE.sides, **ends, matrix=middle)
