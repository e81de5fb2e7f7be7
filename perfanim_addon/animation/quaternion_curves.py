"""Conversion of rotations in any of Blender's rotation modes to quaternions and their curves."""

from collections.abc import Collection
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Quaternion

from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array
from ..blender_versions import by_channel, channels_of, new_curve, slot_of
from .keyframes import bone_path, fill


def rotation_channel(mode: str) -> str:
    """Return the name of the property that holds the rotation in a rotation mode."""
    return {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(mode, "rotation_euler")


def quaternions_of(mode: str, values: Array) -> Array:
    """Return quaternions (F, 4) for values (F, 3 or 4) in a rotation mode."""
    if mode == "QUATERNION":
        return rot.normalize(values)
    if mode == "AXIS_ANGLE":
        return np.array([Quaternion(each[1:], each[0]) for each in values.tolist()])
    return np.array([Euler(each, mode).to_quaternion() for each in values.tolist()])


def keep_in_quaternions(armature_object: bpy.types.Object, bones: Collection[str]) -> None:
    """Add quaternion curves to the animation of bones whose rotation mode will become quaternion."""
    animation = armature_object.animation_data
    turned = [armature_object.pose.bones[name] for name in bones]
    turned = [bone for bone in turned if bone.rotation_mode != "QUATERNION"]
    if animation is None or not turned:
        return
    tracks = animation.nla_tracks if animation.use_nla else ()
    strips = [strip for track in tracks for strip in track.strips if strip.type == "CLIP"]
    played = {(used.action, slot_of(used)) for used in (animation, *strips) if used.action is not None}
    for action, slot in played:
        for channels in channels_of(action, slot) if action.is_editable else ():
            known = by_channel(channels.fcurves)
            for bone in turned:
                if (bone_path(bone.name, "rotation_quaternion"), 0) not in known:
                    _add_quaternions(channels, known, bone)


def _add_quaternions(channels: Any, known: dict[tuple[str, int], Any], bone: bpy.types.PoseBone) -> None:
    """Add a bone's rotation per frame as quaternion curves."""
    channel = rotation_channel(bone.rotation_mode)
    path, now = bone_path(bone.name, channel), list(getattr(bone, channel))
    curves = [known.get((path, component)) for component in range(len(now))]
    keyed = [key.co[0] for curve in curves if curve is not None for key in curve.keyframe_points]
    if not keyed:
        return
    frames = np.union1d(np.arange(np.floor(min(keyed)), np.ceil(max(keyed)) + 1.0), keyed)
    values = [
        [curve.evaluate(frame) if curve is not None else still for curve, still in zip(curves, now, strict=True)]
        for frame in frames
    ]
    quaternions = rot.continuous(quaternions_of(bone.rotation_mode, np.array(values)))
    for component in range(4):
        curve = new_curve(channels, bone_path(bone.name, "rotation_quaternion"), component, bone.name)
        fill(curve, frames, quaternions[:, component], straight=True)
