"""Transforms from the capture space (metres) to the scene.

The first performer's character defines position and scale of the capture space in the scene. A further character keeps
its own scale, so that its feet do not slide; its offset places it where its performer was first seen.
Distances between characters are off by the difference in scale times the distance from that position.
"""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector
from numpy.typing import ArrayLike

from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array
from ...core.retarget.retargeter import RetargetPlan
from ..animation.quaternion_curves import quaternions_of, rotation_channel
from ..character.axes import BLENDER_FROM_WORLD


@dataclass(frozen=True)
class RigidOffset:
    """Rigid transform from a character's own space to the capture space: a rotation (4,), then a shift (3,)."""

    turn: Array
    shift_m: Array

    def apply(self, rotations: ArrayLike, root_positions_m: ArrayLike) -> tuple[Array, Array]:
        """Transform rotations (..., J, 4) and root positions (..., 3)."""
        turned = np.array(rotations, dtype=np.float64)
        turned[..., 0, :] = rot.multiply(self.turn, turned[..., 0, :])
        return turned, rot.rotate(self.turn, np.asarray(root_positions_m, dtype=np.float64)) + self.shift_m

    def apply_to_prop(self, rotations: Array, positions_m: Array) -> tuple[Array, Array]:
        """Transform rotations (..., 4) and positions (..., 3) of a prop."""
        return rot.multiply(self.turn, rotations), rot.rotate(self.turn, positions_m) + self.shift_m


class CaptureSpace:
    """Capture space in the scene, at a character's position and with its scale."""

    def __init__(self, armature_object: bpy.types.Object, plan: RetargetPlan) -> None:
        fit = plan.alignment
        placed = _still_matrix(armature_object)
        self._turn = rot.from_matrix(np.array(placed.to_3x3().normalized()) @ fit.armature_from_world)
        self._linear = fit.units_per_metre * np.array(placed.to_3x3()) @ fit.armature_from_world
        self._origin = np.array(placed.translation)
        self._own = rot.conjugate(rot.from_matrix(BLENDER_FROM_WORLD))

    def to_scene(self, rotations: Array, positions_m: Array) -> tuple[Array, Array]:
        """Transform rotations (..., 4) and positions (..., 3) of props from the capture space to the scene."""
        return rot.multiply(rot.multiply(self._turn, rotations), self._own), self.points_to_scene(positions_m)

    def points_to_scene(self, points_m: Array) -> Array:
        """Transform points (..., 3) from the capture space to the scene."""
        return points_m @ self._linear.T + self._origin

    def points_from_scene(self, points: ArrayLike) -> Array:
        """Transform points (..., 3) from the scene to the capture space."""
        away = np.asarray(points, dtype=np.float64) - self._origin
        return np.asarray(away @ np.linalg.inv(self._linear).T)

    def put_at_origin(self, target: bpy.types.Object) -> None:
        """Move an object to the origin of the space, with the space's axes and scale."""
        turn, place = self.to_scene(rot.identity(), np.zeros(3))
        target.rotation_mode = "QUATERNION"
        target.rotation_quaternion, target.location = Quaternion(turn), Vector(place)
        target.scale = (self.length_in_scene(1.0),) * 3

    def length_in_scene(self, length_m: float) -> float:
        """Convert a length to scene units."""
        return length_m * float(np.cbrt(abs(np.linalg.det(self._linear))))

    def offset_into(self, other: "CaptureSpace", place_m: Array) -> RigidOffset:
        """Return the offset into another space, chosen so that both spaces agree at a position (3,)."""
        turn = rot.multiply(rot.conjugate(self._turn), other._turn)
        here_m = np.linalg.solve(self._linear, other.points_to_scene(place_m) - self._origin)
        return RigidOffset(turn, here_m - rot.rotate(turn, place_m))


def _still_matrix(armature_object: bpy.types.Object) -> Matrix:
    """Return an armature's matrix without its delta transform (its root motion)."""
    mode = armature_object.rotation_mode
    turn = quaternions_of(mode, np.array([getattr(armature_object, rotation_channel(mode))]))[0]
    own = Matrix.LocRotScale(armature_object.location, Quaternion(turn), armature_object.scale)
    parent = armature_object.parent
    return own if parent is None else parent.matrix_world @ armature_object.matrix_parent_inverse @ own
