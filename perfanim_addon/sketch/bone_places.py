"""Positions of controls that follow bones of a rough rig, found from its keys without changing the scene's frame."""

from collections.abc import Iterable, Mapping, Sequence

import bpy
import numpy as np
from mathutils import Matrix

from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array
from ..animation.quaternion_curves import quaternions_of, rotation_channel
from ..blender_versions import action_curves, by_channel
from .controls import EDITING, only_constraint

_OWN = "pose.bones["  # beginning of the data paths of bones; other channels move the whole rig


def followed_bone(control: bpy.types.Object) -> tuple[bpy.types.Object, bpy.types.PoseBone] | None:
    """Return the rig and the bone that a control follows by one *Copy Location* at full influence, else None."""
    held = only_constraint(control, "COPY_LOCATION")
    bone = held.target.pose.bones.get(held.subtarget) if held is not None and held.target.type == "ARMATURE" else None
    return None if bone is None else (held.target, bone)


def curves_that_move(rig: bpy.types.Object, bone: bpy.types.PoseBone) -> list[bpy.types.FCurve]:
    """Return the curves of a rig's action that move a bone: its own, those of its ancestors, and the rig's.

    If no curve moves the bone, all curves are returned, so that it counts as held in the frames of the rig's keys.
    """
    curves = action_curves(rig)
    paths = tuple(f"{each.path_from_id()}." for each in _chain(bone))
    own = [each for each in curves if not each.data_path.startswith(_OWN) or each.data_path.startswith(paths)]
    return own or curves


def places_of_bone(
    rig: bpy.types.Object, bone: bpy.types.PoseBone, frames: Iterable[int]
) -> Mapping[int, Array] | None:
    """Return frame -> location in the scene of a bone's head, from the keys of its rig.

    None if only the evaluated scene shows it: for a rig with NLA strips, drivers, a parent, constraints or object
    keys, and for bones with constraints or partial inheritance in their chain.
    """
    animation, curves = rig.animation_data, action_curves(rig)
    if animation is None or len(animation.drivers) or (animation.use_nla and len(animation.nla_tracks)):
        return None
    held = [each for carrier in (rig, *_chain(bone)) for each in carrier.constraints]
    if rig.parent is not None or rig.data.pose_position == "REST" or any(each.enabled for each in held):
        return None
    if any(not curve.data_path.startswith(_OWN) for curve in curves):
        return None
    links = [link.bone for link in _chain(bone)]
    if not all(each.use_inherit_rotation and each.use_local_location for each in links):
        return None
    if any(each.inherit_scale != "FULL" for each in links):
        return None
    steps = list(frames)
    return dict(zip(steps, _in_scene(rig, _heads(bone, curves, steps)), strict=True))


def place_off_curves(rig: bpy.types.Object, bone: bpy.types.PoseBone, frame: int) -> Array | None:
    """Return the scene location of a bone that has been dragged off its curves in the current frame, else None."""
    shown = np.array(bone.head, dtype=np.float64)
    off = np.max(np.abs(_heads(bone, action_curves(rig), [frame])[0] - shown))
    return _in_scene(rig, shown) if off > EDITING.off_curve else None


def _in_scene(rig: bpy.types.Object, points: Array) -> Array:
    """Transform points (..., 3) from armature space to the scene."""
    world = np.array(rig.matrix_world, dtype=np.float64)
    return np.asarray(points @ world[:3, :3].T + world[:3, 3])


def _chain(bone: bpy.types.PoseBone) -> list[bpy.types.PoseBone]:
    """Return a bone and its ancestors, topmost first."""
    return [*reversed(bone.parent_recursive), bone]


def _heads(bone: bpy.types.PoseBone, curves: Iterable[bpy.types.FCurve], frames: Sequence[int]) -> Array:
    """Return the heads (F, 3) of a bone in armature space, evaluated from F-curves."""
    channels = by_channel(curves)
    poses, above = np.repeat(np.eye(4)[None], len(frames), axis=0), Matrix()
    for link in _chain(bone):
        rest = link.bone.matrix_local
        poses = poses @ (np.array(above.inverted() @ rest) @ _transforms(link, channels, frames))
        above = rest
    return np.asarray(poses[:, :3, 3])


def _transforms(
    link: bpy.types.PoseBone, channels: Mapping[tuple[str, int], bpy.types.FCurve], frames: Sequence[int]
) -> Array:
    """Return a bone's own transforms (F, 4, 4), or (1, 4, 4) if it does not move."""
    path, mode = link.path_from_id(), link.rotation_mode
    columns = []
    for name in ("location", rotation_channel(mode), "scale"):
        for axis, present in enumerate(getattr(link, name)):
            curve = channels.get((f"{path}.{name}", axis))
            columns.append([present] if curve is None else [curve.evaluate(frame) for frame in frames])
    table = np.stack(np.broadcast_arrays(*(np.array(column, dtype=np.float64) for column in columns)), axis=1)
    result = np.zeros((len(table), 4, 4))
    result[:, :3, :3] = rot.to_matrix(quaternions_of(mode, table[:, 3:-3])) * table[:, None, -3:]
    result[:, :3, 3], result[:, 3, 3] = table[:, :3], 1.0
    return result
