"""The performers' room in the scene: where what is told in its metres stands beside a character.

Each character is as large as it is and steps by its own legs, so two of them share no scale in general. The room is
that of the character that the capture drives. A further character is carried into it: it turns as its performer does,
and where the performer was first seen it stands where the room has that place; from there on it goes by its own steps,
and its feet do not slide. Two characters then stand to each other as the performers did, but for the difference of
their scales times the way from that place.
"""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector
from numpy.typing import ArrayLike, NDArray

from ...core.geometry import rotations as rot
from ...core.retarget.retargeter import RetargetPlan
from ..character.axes import BLENDER_FROM_WORLD

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigidOffset:
    """A rigid motion of the performers' room, after which a character of its own room stands in another's.

    Args:
        turn: (4,) quaternion.
        shift_m: (3,) added after the turn, metres of the room.
    """

    turn: Array
    shift_m: Array

    def moved(self, rotations: ArrayLike, root_positions_m: ArrayLike) -> tuple[Array, Array]:
        """Return rotations (..., J, 4), of which the root's changes, and root positions (..., 3) of poses carried."""
        turned = np.array(rotations, dtype=np.float64)
        turned[..., 0, :] = rot.multiply(self.turn, turned[..., 0, :])
        return turned, rot.rotate(self.turn, np.asarray(root_positions_m, dtype=np.float64)) + self.shift_m


class CaptureSpace:
    """From the performers' room to the scene, as a character stands in it: its step is the performer's.

    Args:
        armature_object: the character.
        plan: for driving it.
    """

    def __init__(self, armature_object: bpy.types.Object, plan: RetargetPlan) -> None:
        fit = plan.alignment
        placed = _still_matrix(armature_object)
        self._turn = rot.from_matrix(np.array(placed.to_3x3().normalized()) @ fit.armature_from_world)
        self._linear = fit.units_per_metre * np.array(placed.to_3x3()) @ fit.armature_from_world
        self._origin = np.array(placed.translation)
        self._own = rot.conjugate(rot.from_matrix(BLENDER_FROM_WORLD))

    def brought(self, turns: Array, places_m: Array) -> tuple[Array, Array]:
        """Return quaternions (..., 4) and locations (..., 3) in the scene of props' turns and places in the world."""
        return rot.multiply(rot.multiply(self._turn, turns), self._own), self.placed(places_m)

    def placed(self, places_m: Array) -> Array:
        """Return where places (..., 3) of the world are in the scene."""
        return places_m @ self._linear.T + self._origin

    def put_at_origin(self, target: bpy.types.Object) -> None:
        """Let an object of the product's own axes stand at the room's origin, in its axes and its scale."""
        turn, place = self.brought(rot.identity(), np.zeros(3))
        target.rotation_mode = "QUATERNION"
        target.rotation_quaternion, target.location = Quaternion(turn), Vector(place)
        target.scale = (float(np.cbrt(abs(np.linalg.det(self._linear)))),) * 3

    def carried_into(self, other: "CaptureSpace", place_m: Array) -> RigidOffset:
        """Return what brings a character of this room into another's, so that the two agree at a place (3,)."""
        turn = rot.multiply(rot.conjugate(self._turn), other._turn)
        here_m = np.linalg.solve(self._linear, other.placed(place_m) - self._origin)
        return RigidOffset(turn, here_m - rot.rotate(turn, place_m))


def _still_matrix(armature_object: bpy.types.Object) -> Matrix:
    """Return where an armature stands without its delta transform, which may carry it through the room."""
    mode = armature_object.rotation_mode
    if mode == "QUATERNION":
        turn = armature_object.rotation_quaternion
    elif mode == "AXIS_ANGLE":
        angle, *axis = armature_object.rotation_axis_angle
        turn = Quaternion(axis, angle)
    else:
        turn = armature_object.rotation_euler.to_quaternion()
    own = Matrix.LocRotScale(armature_object.location, turn, armature_object.scale)
    parent = armature_object.parent
    return own if parent is None else parent.matrix_world @ armature_object.matrix_parent_inverse @ own
