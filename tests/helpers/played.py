"""What Blender plays, brought back to the product's space: shares no code with the add-on's conversion."""

import bpy
import numpy as np
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.displayed_joint_names import NAMINGS

_PRODUCT_FROM_BLENDER = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def points_from_blender(points) -> np.ndarray:
    """Blender points (..., 3) in the product's axes: (x, z, -y)."""
    return np.asarray(points, dtype=np.float64) @ _PRODUCT_FROM_BLENDER.T


def points_to_blender(points) -> np.ndarray:
    """Points (..., 3) of the product in Blender's axes: (x, -z, y)."""
    return np.asarray(points, dtype=np.float64) @ _PRODUCT_FROM_BLENDER


def curves_of(animated) -> list:
    """The curves of the action that an object plays: the action's own up to Blender 4.3, its slot's from 4.4 on."""
    animation = animated.animation_data
    if animation is None or animation.action is None:
        return []
    if bpy.app.version < (4, 4, 0):
        return list(animation.action.fcurves)
    strips = [strip for layer in animation.action.layers for strip in layer.strips]
    bags = [strip.channelbag(animation.action_slot) for strip in strips]
    return [curve for bag in bags if bag is not None for curve in bag.fcurves]


def played_poses(object_name: str, frames, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (F, J, 4) and root positions (F, 3) of a character of the product's own, as its bones stand."""
    found = [_pose_at(object_name, float(frame), skeleton) for frame in frames]
    return np.array([rotations for rotations, _ in found]), np.array([root for _, root in found])


def _pose_at(object_name: str, frame: float, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    whole = int(np.floor(frame))
    bpy.context.scene.frame_set(whole, subframe=min(frame - whole, 0.999999))
    obj = bpy.data.objects[object_name].evaluated_get(bpy.context.evaluated_depsgraph_get())
    bones = [obj.pose.bones[NAMINGS["blender"][name]] for name in skeleton.names]
    posed = np.array([bone.matrix.to_3x3() for bone in bones], dtype=np.float64)
    rest = np.array([bone.bone.matrix_local.to_3x3() for bone in bones], dtype=np.float64)
    turned = _PRODUCT_FROM_BLENDER @ posed @ np.swapaxes(rest, -1, -2) @ _PRODUCT_FROM_BLENDER.T
    world = rot.from_matrix(turned)
    local = world.copy()
    local[1:] = rot.multiply(rot.conjugate(world[skeleton.parents[1:]]), world[1:])
    return local, points_from_blender(bones[0].head)


def key_times(curves) -> np.ndarray:
    """Scene frames at which any of the curves has a key, ascending."""
    return np.array(sorted({key.co[0] for curve in curves for key in curve.keyframe_points}))


def select_bones(armature_object, names) -> None:
    """Select these bones and no others."""
    for bone in armature_object.pose.bones:
        holder = bone if bpy.app.version >= (5, 0, 0) else bone.bone
        holder.select = bone.name in names
