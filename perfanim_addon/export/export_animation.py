"""Export of an animated character through Blender's own exporters."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.body.motion import Motion
from ...core.errors import CharacterError, FormatError
from ...core.formats.motion.bvh_transform import transform_bvh
from ...core.geometry.arrays import Array
from ...core.system.files import atomic_path
from ..animation.actions import scene_frames, write_action
from ..blender_versions import play, played
from ..character.create_character import find_armature
from ..character.retarget_plans import bones_of
from ..character.selection import leave_modes, select_only
from .bone_names import exported_bone_names

ENDINGS = {"BVH": ".bvh", "FBX": ".fbx", "GLTF": ".glb"}

_YUP_FROM_BLENDER = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Form:
    """Options for an exported file."""

    meshes: bool = True  # include the meshes deformed by the armature
    naming: str = ""  # joint naming for mapped bones; "" keeps their names
    scale: float = 1.0  # BVH units per scene unit: 100 for centimetres


def export_poses(
    context: bpy.types.Context, object_name: str, target: Path, kind: str, motion: Motion, form: Form
) -> int:
    """Write a motion on an armature to a file; return the number of frames.

    The file has a whole number of frames per second.

    Args:
        object_name: Name of the armature object.
        kind: Key of `ENDINGS`.

    Raises:
        CharacterError: The armature cannot be driven, or is hidden.
        FormatError: The file cannot be written.
    """
    armature_object = find_armature(object_name)
    with _lent(context, armature_object):
        scene = context.scene
        scene.render.fps, scene.render.fps_base = round(motion.fps), 1.0
        frames = scene_frames(np.arange(motion.frames) / motion.fps, scene)
        animation = armature_object.animation_data or armature_object.animation_data_create()
        animation.use_nla, animation.action = False, None  # only the new action plays
        poses = motion.rotations, motion.root_positions_m, motion.skeleton
        write_action(object_name, frames, *poses, name=target.stem)
        scene.frame_start, scene.frame_end = 1, max(1, int(np.floor(frames[-1] + 1e-3)))
        bones = bones_of(armature_object) if form.naming else {}
        write_played(context, armature_object, target, kind, bones, form)
        return int(scene.frame_end)


def write_played(
    context: bpy.types.Context,
    armature_object: bpy.types.Object,
    target: Path,
    kind: str,
    bones: Mapping[str, str],
    form: Form,
) -> None:
    """Write an armature's animation over the scene's frame range.

    BVH files have y up, scene units, and the armature at its position in the scene; FBX and glTF files have Blender's
    defaults.

    Args:
        kind: Key of `ENDINGS`.
        bones: Bone of each joint, for `form.naming`.

    Raises:
        CharacterError: The armature is hidden, or its bones cannot be renamed.
        FormatError: The file cannot be written.
    """
    scene = context.scene
    if not armature_object.visible_get():
        advice = "show it: exporters skip hidden objects"
        raise CharacterError("is hidden", where=armature_object.name, advice=advice)
    meshes = [each for each in context.view_layer.objects if each.type == "MESH" and each.visible_get()]
    worn = [each for each in meshes if form.meshes and kind != "BVH" and each.find_armature() == armature_object]
    select_only(context, [armature_object, *worn])
    names = exported_bone_names(armature_object, bones, form.naming) if form.naming else nullcontext()
    with names, atomic_path(target) as temporary:
        _run(target, kind, temporary, (scene.frame_start, scene.frame_end))
        if kind == "BVH":
            scale = np.diag([form.scale, form.scale, form.scale, 1.0])
            spaces = scale @ _YUP_FROM_BLENDER @ _places(context, armature_object)
            temporary.write_text(transform_bvh(temporary.read_text(encoding="utf-8"), spaces), encoding="utf-8")


def _places(context: bpy.types.Context, armature_object: bpy.types.Object) -> Array:
    """Return the armature's world matrices (F, 4, 4) in the frames of the scene."""
    found = []
    for frame in range(context.scene.frame_start, context.scene.frame_end + 1):
        context.scene.frame_set(frame)
        found.append(armature_object.evaluated_get(context.evaluated_depsgraph_get()).matrix_world.copy())
    return np.array(found, dtype=np.float64)


def _run(target: Path, kind: str, path: Path, frames: tuple[int, int]) -> None:
    first, last = frames
    writers: dict[str, Callable[[], set[str]]] = {
        "BVH": lambda: bpy.ops.export_anim.bvh(
            filepath=str(path), check_existing=False, frame_start=first, frame_end=last, root_transform_only=False
        ),
        "FBX": lambda: bpy.ops.export_scene.fbx(
            filepath=str(path),
            check_existing=False,
            use_selection=True,
            object_types={"ARMATURE", "MESH"},
            add_leaf_bones=False,
            bake_anim=True,
            bake_anim_use_nla_strips=False,
            bake_anim_use_all_actions=False,
            bake_anim_simplify_factor=0.0,
        ),
        "GLTF": lambda: bpy.ops.export_scene.gltf(
            filepath=str(path),
            check_existing=False,
            export_format="GLB",
            use_selection=True,
            export_animation_mode="SCENE",  # what is seen: other modes of 4.2 write another action of the character
            export_frame_range=True,
            export_anim_slide_to_zero=True,
            export_optimize_animation_size=False,
        ),
    }
    try:
        if "FINISHED" not in writers[kind]():
            raise RuntimeError("cancelled")
    except (RuntimeError, AttributeError, TypeError, OSError) as error:
        line = (str(error).strip().splitlines() or ["unknown error"])[-1]
        advice = f"enable Blender's own {kind} exporter under Preferences > Add-ons"
        raise FormatError(f"cannot be exported ({line})", where=str(target), advice=advice) from error


@contextmanager
def _lent(context: bpy.types.Context, armature_object: bpy.types.Object) -> Iterator[None]:
    """Restore everything that an export changes."""
    layer = context.view_layer
    active, selected = layer.objects.active, [obj for obj in layer.objects if obj.select_get()]
    mode = active.mode if active is not None else "OBJECT"
    leave_modes(context)
    known = set(bpy.data.actions)
    scene, rendered = context.scene, context.scene.render
    rate, span = (rendered.fps, rendered.fps_base), (scene.frame_start, scene.frame_end)
    frame, part = scene.frame_current, scene.frame_subframe
    pose_before = _pose_state(armature_object)
    try:
        yield
    finally:
        _restore_pose(armature_object, *pose_before)
        for action in set(bpy.data.actions) - known:
            bpy.data.actions.remove(action)
        (rendered.fps, rendered.fps_base), (scene.frame_start, scene.frame_end) = rate, span
        scene.frame_set(frame, subframe=part)
        for obj in layer.objects:
            obj.select_set(obj in selected)
        layer.objects.active = active
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)


_OBJECT_PLACE = ("rotation_mode", "delta_location", "delta_rotation_quaternion", "delta_rotation_euler")


def _pose_state(armature_object: bpy.types.Object) -> tuple[Any, ...]:
    """Return everything about an armature's pose that writing a motion to it changes."""
    bones = []
    for bone in armature_object.pose.bones:
        switches = {name: value for name, value in bone.items() if isinstance(value, float | int)}
        muted = [constraint.mute for constraint in bone.constraints]
        bones.append((bone.name, bone.rotation_mode, bone.matrix_basis.copy(), switches, muted))
    place = {name: copy(getattr(armature_object, name)) for name in _OBJECT_PLACE}
    return played(armature_object), bones, place, armature_object.data.pose_position


def _restore_pose(
    armature_object: bpy.types.Object,
    before: tuple[Any, ...] | None,
    bones: list[tuple[Any, ...]],
    place: dict[str, Any],
    pose_position: str,
) -> None:
    play(armature_object, before)
    for name, mode, basis, switches, muted in bones:
        bone = armature_object.pose.bones[name]
        bone.rotation_mode = mode
        bone.matrix_basis = basis
        for key, value in switches.items():
            bone[key] = value
        for constraint, mute in zip(bone.constraints, muted, strict=True):
            constraint.mute = mute
    for name, value in place.items():
        setattr(armature_object, name, value)
    armature_object.data.pose_position = pose_position
