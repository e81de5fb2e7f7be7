"""Places of controls that go with bones of a rough rig.

They are computed from the rig's keys, without a change of the scene's frame.
"""

from collections.abc import Iterable, Mapping, Sequence

import bpy
import numpy as np
from mathutils import Euler, Matrix, Quaternion

from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array
from .controls import action_curves

_MOVED = 1e-4  # of the rig's metre, by which a bone is off its curves while it is posed
_OWN = "pose.bones["  # beginning of a bone's channels; others move the whole rig


def followed_bone(control: bpy.types.Object) -> tuple[bpy.types.Object, bpy.types.PoseBone] | None:
    """Return the rig and the bone that a control goes with; None without them.

    It goes with a bone by one *Copy Location* at full influence.
    """
    held = control.constraints[0] if len(control.constraints) == 1 else None
    if held is None or held.type != "COPY_LOCATION" or held.mute or held.influence < 1.0 or control.parent is not None:
        return None
    rig = held.target
    bone = rig.pose.bones.get(held.subtarget) if rig is not None and rig.type == "ARMATURE" else None
    return None if bone is None else (rig, bone)


def curves_that_move(rig: bpy.types.Object, bone: bpy.types.PoseBone) -> list[bpy.types.FCurve]:
    """Return the curves of a rig's action that move a bone.

    These are the bone's own, those of bones above, and the rig's. All curves where none moves it: it stands still as
    long as the rig moves.
    """
    curves = action_curves(rig)
    paths = tuple(f"{each.path_from_id()}." for each in _chain(bone))
    own = [each for each in curves if not each.data_path.startswith(_OWN) or each.data_path.startswith(paths)]
    return own or curves


def places_of_bone(
    rig: bpy.types.Object, bone: bpy.types.PoseBone, frames: Iterable[int]
) -> Mapping[int, Array] | None:
    """Return frame -> location in the scene of a bone's head by the keys of its rig.

    None where only the scene shows it: for a rig with strips, drivers, a parent, constraints or keys of its own, and
    below bones with constraints or that do not inherit all from those above.
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
    """Return where a bone is shown in the present frame, None where its keys have it."""
    shown = np.array(bone.head, dtype=np.float64)
    off = np.max(np.abs(_heads(bone, action_curves(rig), [frame])[0] - shown))
    return _in_scene(rig, shown) if off > _MOVED else None


def _in_scene(rig: bpy.types.Object, points: Array) -> Array:
    """Return points (..., 3) of a rig's space in the scene."""
    world = np.array(rig.matrix_world, dtype=np.float64)
    return np.asarray(points @ world[:3, :3].T + world[:3, 3])


def _chain(bone: bpy.types.PoseBone) -> list[bpy.types.PoseBone]:
    """Return a bone and those above, the topmost first."""
    return [*reversed(bone.parent_recursive), bone]


def _heads(bone: bpy.types.PoseBone, curves: Iterable[bpy.types.FCurve], frames: Sequence[int]) -> Array:
    """Return the heads (F, 3) of a bone in its rig's space by curves at frames."""
    channels = {(curve.data_path, curve.array_index): curve for curve in curves}
    poses, above = np.repeat(np.eye(4)[None], len(frames), axis=0), Matrix()
    for link in _chain(bone):
        rest = link.bone.matrix_local
        poses = poses @ (np.array(above.inverted() @ rest) @ _transforms(link, channels, frames))
        above = rest
    return np.asarray(poses[:, :3, 3])


def _transforms(
    link: bpy.types.PoseBone, channels: Mapping[tuple[str, int], bpy.types.FCurve], frames: Sequence[int]
) -> Array:
    """Return a bone's own transforms (F, 4, 4), (1, 4, 4) where nothing moves."""
    path, mode = link.path_from_id(), link.rotation_mode
    turn = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(mode, "rotation_euler")
    columns = []
    for name in ("location", turn, "scale"):
        for axis, present in enumerate(getattr(link, name)):
            curve = channels.get((f"{path}.{name}", axis))
            columns.append([present] if curve is None else [curve.evaluate(frame) for frame in frames])
    table = np.stack(np.broadcast_arrays(*(np.array(column, dtype=np.float64) for column in columns)), axis=1)
    result = np.zeros((len(table), 4, 4))
    result[:, :3, :3] = rot.to_matrix(_quaternions(mode, table[:, 3:-3])) * table[:, None, -3:]
    result[:, :3, 3], result[:, 3, 3] = table[:, :3], 1.0
    return result


def _quaternions(mode: str, values: Array) -> Array:
    """Return quaternions (F, 4) of values of a bone's rotation mode."""
    if mode == "QUATERNION":
        return rot.normalize(values)
    if mode == "AXIS_ANGLE":
        return np.array([Quaternion(each[1:], each[0]) for each in values.tolist()])
    return np.array([Euler(each, mode).to_quaternion() for each in values.tolist()])
