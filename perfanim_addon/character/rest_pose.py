"""Correction of a character's rest pose to what its importer shows.

glTF files place, turn and scale joints by nodes, but bind meshes by separate matrices. If the two differ, the
importer takes the bones from the matrices and poses the topmost bone so that the scene matches the nodes. With its pose
cleared, such a character would lie down, sink or be a hundred times too large, so the pose of the topmost bone becomes
part of the rest pose.
"""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from ...core.geometry.arrays import Array
from ..blender_versions import detach_action
from .armature_reading import LIMITS, own_scale


@dataclass(frozen=True)
class PlacementLimits:
    """Limits that distinguish a placement by the topmost bone from a pose left by an animation."""

    still_rad: float = 0.02  # rotation up to which a bone counts as at rest
    step: float = 0.5  # least vertical shift of the topmost bone, share of the body's extent; a crouch shifts it less
    height: float = 0.5  # smallest height of a standing body, share of its extent; a lying body is flatter


_LIMITS = PlacementLimits()


def release_pose(armature_object: bpy.types.Object) -> None:
    """Detach an armature's animation, which stays in the file, and reset the bones to the displayed rest pose."""
    bpy.context.view_layer.update()
    placement = _placement(armature_object)
    animation = armature_object.animation_data
    if animation is not None:
        detach_action(animation)
        for track in animation.nla_tracks:
            track.mute = True
    if placement is not None:
        _take_into_rest(armature_object, placement)
    for bone in armature_object.pose.bones:
        scale = own_scale(bone)
        bone.matrix_basis.identity()
        bone.scale = (scale,) * 3


def _top(armature_object: bpy.types.Object) -> bpy.types.PoseBone:
    """Return the topmost bone that carries most of the others."""
    tops = [bone for bone in armature_object.pose.bones if bone.parent is None]
    return max(tops, key=lambda bone: len(bone.children_recursive))


def _placement(armature_object: bpy.types.Object) -> Matrix | None:
    """Return the transform in armature space by which the topmost bone places the body, or None."""
    if armature_object.library is not None or armature_object.data.library is not None:
        return None
    top, bones = _top(armature_object), armature_object.pose.bones
    rotation = np.array((top.matrix @ top.bone.matrix_local.inverted()).to_quaternion().to_matrix())
    if any(bone.matrix_basis.to_quaternion().angle > _LIMITS.still_rad for bone in bones if bone != top):
        rotation = _quarters(rotation)  # what remains is a lean and a turn from an animation
    scale = own_scale(top)
    in_scene = np.array(armature_object.matrix_world.to_3x3())
    heads = scale * np.array([bone.bone.head_local for bone in bones])
    before, after = (np.ptp(heads @ turn.T @ in_scene.T, axis=0) for turn in (np.eye(3), rotation))
    stands_up = before[2] < _LIMITS.height * np.max(before) and after[2] >= _LIMITS.height * np.max(after)
    step = abs((in_scene @ (top.head - top.bone.head_local))[2])
    if abs(scale - 1.0) <= LIMITS.same_scale and not stands_up and step <= _LIMITS.step * np.max(after):
        return None
    about = Matrix(rotation.tolist()).to_4x4() @ Matrix.Scale(scale, 4)
    return Matrix.Translation(top.head) @ about @ Matrix.Translation(-top.bone.head_local)


def _quarters(rotation: Array) -> Array:
    """Return the nearest rotation (3, 3) made of quarter turns; the identity if there is no unique one."""
    nearest = np.where(np.abs(rotation) > np.cos(np.radians(44.0)), np.sign(rotation), 0.0)
    return nearest if abs(np.linalg.det(nearest) - 1.0) < 1e-9 else np.eye(3)


def _take_into_rest(armature_object: bpy.types.Object, placement: Matrix) -> None:
    """Transform the rest pose of bones and meshes; objects parented to a bone stay where they are."""
    hung = [child for child in armature_object.children if child.parent_type == "BONE"]
    places = [child.matrix_world.copy() for child in hung]
    for mesh_object in bpy.context.scene.objects:
        if mesh_object.type == "MESH" and mesh_object.find_armature() == armature_object:
            own = mesh_object.matrix_world.inverted() @ armature_object.matrix_world
            mesh_object.data.transform(own @ placement @ own.inverted(), shape_keys=True)
    armature_object.data.transform(placement)
    top = _top(armature_object)
    top.matrix_basis.identity()
    bpy.context.view_layer.update()
    for child, place in zip(hung, places, strict=True):
        child.matrix_world = place
