"""Placeholder object of a prop: a shaft, arms to the markers, markers as balls."""

import bpy
import numpy as np

from ...core.geometry.arrays import Array
from ...core.markers.prop import Prop
from .axes import points_to_blender

_SIDES = 8
_SHAFT_M, _ARM_M, _MARKER_M = 0.012, 0.005, 0.016
_ON_SHAFT_M = 0.03
_BALL_RINGS = (-0.9, -0.45, 0.0, 0.45, 0.9)  # sines of the heights


def add_prop_object(context: bpy.types.Context, prop: Prop) -> bpy.types.Object:
    """Add and return a mesh of a prop at the scene's origin, its y along Z."""
    places = prop.positions_m
    low, high = float(places[:, 1].min()), float(places[:, 1].max())
    parts = [_rod(np.array([0.0, low, 0.0]), np.array([0.0, high, 0.0]), _SHAFT_M)]
    for place in places:
        foot = np.array([0.0, place[1], 0.0])
        if np.linalg.norm(place - foot) > _ON_SHAFT_M:
            parts.append(_rod(foot, place, _ARM_M))
        parts.append(_ball(place))
    corners: list[Array] = []
    faces: list[tuple[int, ...]] = []
    for points, sides in parts:
        start = sum(map(len, corners))
        corners.append(points)
        faces += [tuple(start + corner for corner in side) for side in sides]
    mesh = bpy.data.meshes.new(prop.name)
    mesh.from_pydata(points_to_blender(np.concatenate(corners)).tolist(), [], faces)
    made = bpy.data.objects.new(prop.name, mesh)
    made.rotation_mode = "QUATERNION"
    (context.collection or context.scene.collection).objects.link(made)
    return made


def _rings(middles: Array, radii: Array, across: Array, beside: Array) -> tuple[Array, list[tuple[int, ...]]]:
    """Return corners and faces of rings (N,) one above the other, closed at both ends."""
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * beside
    points = (middles[:, None] + radii[:, None, None] * circle).reshape(-1, 3)
    faces: list[tuple[int, ...]] = [tuple(range(_SIDES))[::-1]]
    for ring in range(len(middles) - 1):
        for side in range(_SIDES):
            first, second = ring * _SIDES + side, ring * _SIDES + (side + 1) % _SIDES
            faces.append((first, second, second + _SIDES, first + _SIDES))
    faces.append(tuple(range((len(middles) - 1) * _SIDES, len(middles) * _SIDES)))
    return points, faces


def _rod(start: Array, end: Array, radius: float) -> tuple[Array, list[tuple[int, ...]]]:
    along = (end - start) / np.linalg.norm(end - start)
    helper = np.eye(3)[int(np.argmin(np.abs(along)))]
    across = np.cross(along, helper)
    across /= np.linalg.norm(across)
    return _rings(np.stack((start, end)), np.full(2, radius), across, np.cross(along, across))


def _ball(middle: Array) -> tuple[Array, list[tuple[int, ...]]]:
    heights = np.array(_BALL_RINGS)
    middles = middle + _MARKER_M * heights[:, None] * np.array([0.0, 1.0, 0.0])
    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    return _rings(middles, _MARKER_M * np.sqrt(1.0 - heights**2), z, x)
