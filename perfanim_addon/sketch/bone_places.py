"""Places of controls that go with bones of a rough rig.

They are computed from the rig's keys, without a change of the scene's frame.
"""

from collections.abc import Iterable, Mapping, Sequence

import bpy
import numpy as np
from mathutils import Euler, Matrix, Quaternion, Vector

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
    below bones with constraints.
    """
    animation, curves = rig.animation_data, action_curves(rig)
    if animation is None or len(animation.drivers) or (animation.use_nla and len(animation.nla_tracks)):
        return None
    held = [each for carrier in (rig, *_chain(bone)) for each in carrier.constraints]
    if rig.parent is not None or rig.data.pose_position == "REST" or any(each.enabled for each in held):
        return None
    if any(not curve.data_path.startswith(_OWN) for curve in curves):
        return None
    steps = list(frames)
    heads = _heads(bone, curves, steps)
    return {step: np.array(rig.matrix_world @ head, dtype=np.float64) for step, head in zip(steps, heads, strict=True)}


def place_off_curves(rig: bpy.types.Object, bone: bpy.types.PoseBone, frame: int) -> Array | None:
    """Return where a bone is shown in the present frame, None where its keys have it."""
    (head,) = _heads(bone, action_curves(rig), [frame])
    off = max(abs(one - other) for one, other in zip(head, bone.head, strict=True))
    return np.array(rig.matrix_world @ bone.head, dtype=np.float64) if off > _MOVED else None


def _chain(bone: bpy.types.PoseBone) -> list[bpy.types.PoseBone]:
    """Return a bone and those above, the topmost first."""
    return [*reversed(bone.parent_recursive), bone]


def _heads(bone: bpy.types.PoseBone, curves: Iterable[bpy.types.FCurve], frames: Sequence[int]) -> list[Vector]:
    """Return the heads of a bone in its rig's space by curves at frames."""
    channels = {(curve.data_path, curve.array_index): curve for curve in curves}
    poses, above = [Matrix()] * len(frames), None
    for link in _chain(bone):
        rest, pose_of = link.bone.matrix_local, link.bone.convert_local_to_pose
        if above is None:
            poses = [pose_of(own, rest) for own in _transforms(link, channels, frames)]
        else:
            above_rest = above.bone.matrix_local
            poses = [
                pose_of(own, rest, parent_matrix=pose, parent_matrix_local=above_rest)
                for own, pose in zip(_transforms(link, channels, frames), poses, strict=True)
            ]
        above = link
    return [pose.translation for pose in poses]


def _transforms(
    link: bpy.types.PoseBone, channels: Mapping[tuple[str, int], bpy.types.FCurve], frames: Sequence[int]
) -> list[Matrix]:
    """Return a bone's own transforms at frames."""
    path, mode = link.path_from_id(), link.rotation_mode
    turn = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(mode, "rotation_euler")
    columns, is_moving = {}, False
    for name in ("location", turn, "scale"):
        found = [channels.get((f"{path}.{name}", axis)) for axis in range(len(getattr(link, name)))]
        is_moving |= any(found)
        columns[name] = list(zip(found, getattr(link, name), strict=True))

    def at(frame: int) -> Matrix:
        place, angles, size = (
            [present if curve is None else curve.evaluate(frame) for curve, present in column]
            for column in columns.values()
        )
        return Matrix.LocRotScale(Vector(place), _rotation(mode, angles), Vector(size))

    return [at(frame) for frame in frames] if is_moving else [at(0)] * len(frames)


def _rotation(mode: str, values: list[float]) -> Quaternion:
    """Return a rotation of a bone's mode."""
    if mode == "QUATERNION":
        return Quaternion(values).normalized()
    if mode == "AXIS_ANGLE":
        return Quaternion(values[1:], values[0])
    return Euler(values, mode).to_quaternion()
