"""Keys of finger bones: from a frame on, a hand holds a pose."""

from collections.abc import Mapping, Sequence
from typing import Any

import bpy
import numpy as np

from ...core.errors import CharacterError
from ...core.geometry.arrays import Array
from ...core.retarget.hand_poses import HAND_POSES, finger_turns
from ..blender_versions import assign, channels_of, first_slot, new_channels, new_curve, slot_of
from ..character.armature_reading import read_armature_rest
from ..character.retarget_plans import bones_of
from .keyframes import LEFT, REACHED, bone_path, is_hand_pose
from .quaternion_curves import keep_in_quaternions

BLEND_FRAMES = 5  # a hand closes in a fifth of a second, at the film rate of 24 frames per second


def hand_turns(armature_object: bpy.types.Object, sides: Sequence[str], name: str) -> dict[str, Array]:
    """Return the rotation (4,) of each finger bone for a preset of `HAND_POSES`, relative to rest.

    Args:
        sides: "l", "r".

    Raises:
        CharacterError: The character has no bone map, or none for the fingers of a hand.
    """
    rest, bones = read_armature_rest(armature_object), bones_of(armature_object)
    turns: dict[str, Array] = {}
    for side in sides:
        turns |= finger_turns(rest, bones, side, HAND_POSES[name])
    return turns


def key_hands(armature_object: bpy.types.Object, turns: Mapping[str, Array], frame: float, blend_frames: float) -> str:
    """Key finger bones in the active action, or a new one: from `frame` on they hold their turns.

    A take's own keys of these bones are removed, because nothing of the fingers was captured.

    Args:
        turns: Rotation (4,) of each bone, as `hand_turns` returns them.
        frame: Scene frame in which the pose is reached.
        blend_frames: Frames before `frame` in which the fingers leave their pose.

    Returns:
        The action's name.

    Raises:
        CharacterError: The action cannot be edited.
    """
    animation = armature_object.animation_data or armature_object.animation_data_create()
    action = animation.action
    if animation.use_tweak_mode or (action is not None and not action.is_editable):
        what, advice = "its animation cannot be edited", "leave tweak mode, or make the action local"
        raise CharacterError(what, where=armature_object.name, advice=advice)
    keep_in_quaternions(armature_object, turns)
    if action is None:
        action = bpy.data.actions.new("Hands")
        new_channels(action, armature_object)
        assign(animation, action)
    channels = next(channels_of(action, slot_of(animation) or first_slot(action)), None)
    if channels is None:
        channels = new_channels(action, armature_object)
    for name, turn in turns.items():
        bone = armature_object.pose.bones[name]
        bone.rotation_mode = "QUATERNION"
        _key_bone(channels, bone, turn, frame, blend_frames)
        bone.rotation_quaternion = turn
    return str(action.name)


def _key_bone(channels: Any, bone: bpy.types.PoseBone, turn: Array, frame: float, blend_frames: float) -> None:
    path, begin = bone_path(bone.name, "rotation_quaternion"), frame - blend_frames
    curves = [channels.fcurves.find(path, index=component) for component in range(4)]
    shown = zip(curves, bone.rotation_quaternion, strict=True)
    before = np.array([now if curve is None else curve.evaluate(begin) for curve, now in shown])
    # fingers turn by less than half a turn, so equal signs of w are the shorter way between any two poses
    before, turn = (each if each[0] >= 0.0 else -each for each in (before, turn))
    for component, value in enumerate(turn.tolist()):
        curve = curves[component] or new_curve(channels, path, component, bone.name)
        points = curve.keyframe_points
        is_first = not is_hand_pose(curve) and (len(points) == 0 or points[0].co[0] > begin)
        if not is_hand_pose(curve):
            points.clear()
        for place in reversed(range(len(points))):
            if begin <= points[place].co[0] <= frame:
                points.remove(points[place])
        following = next((key for key in points if key.co[0] > frame), None)
        if following is not None and following.type == LEFT:
            following.co[1] = value
        if not is_first:
            _insert(curve, begin, float(before[component]), LEFT)
        _insert(curve, frame, value, REACHED)
        curve.update()


def _insert(curve: bpy.types.FCurve, frame: float, value: float, kind: str) -> None:
    key = curve.keyframe_points.insert(frame, value, keyframe_type=kind)
    key.handle_left_type = key.handle_right_type = "AUTO_CLAMPED"
