"""Quaternion curves beside the Euler or axis-angle curves of an animation."""

from collections.abc import Collection
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Quaternion

from ...core.geometry import rotations as rot
from .channels import channels_of, new_curve, slot_of
from .keyframes import bone_path, fill


def keep_in_quaternions(armature_object: bpy.types.Object, bones: Collection[str]) -> None:
    """Add quaternion curves to the animation of bones that switch to quaternions."""
    animation = armature_object.animation_data
    if animation is None:
        return
    tracks = animation.nla_tracks if animation.use_nla else ()
    strips = [strip for track in tracks for strip in track.strips if strip.type == "CLIP"]
    played = {(used.action, slot_of(used)) for used in (animation, *strips) if used.action is not None}
    turned = [armature_object.pose.bones[name] for name in bones]
    turned = [bone for bone in turned if bone.rotation_mode != "QUATERNION"]
    for action, slot in played:
        for channels in channels_of(action, slot) if action.is_editable and turned else ():
            known = {(curve.data_path, curve.array_index): curve for curve in channels.fcurves}
            for bone in turned:
                if (bone_path(bone.name, "rotation_quaternion"), 0) not in known:
                    _add_quaternions(channels, known, bone)


def _add_quaternions(channels: Any, known: dict[tuple[str, int], Any], bone: bpy.types.PoseBone) -> None:
    """Add a bone's rotation per frame as quaternion curves."""
    is_axis_angle = bone.rotation_mode == "AXIS_ANGLE"
    channel = "rotation_axis_angle" if is_axis_angle else "rotation_euler"
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
    turns = [Quaternion(v[1:], v[0]) if is_axis_angle else Euler(v, bone.rotation_mode).to_quaternion() for v in values]
    quaternions = rot.continuous(np.array(turns, dtype=np.float64))
    for component in range(4):
        curve = new_curve(channels, bone_path(bone.name, "rotation_quaternion"), component, bone.name)
        fill(curve, frames, quaternions[:, component], straight=True)
