"""Takes on characters as BVH, FBX and glTF: read by Blender's importers, the joints are where they were."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import CharacterError, FormatError
from perfanim.core.formats.motion.bvh import read_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon.animation import actions
from perfanim.perfanim_addon.character import create_character
from perfanim.perfanim_addon.export.export_animation import ENDINGS, Form, export_poses
from played import curves_of

SAME_M = 0.001


@pytest.fixture(scope="module")
def motion() -> Motion:
    walk = read_motion(next(MOTION.glob("running-01*.bvh")))
    return sliced(walk, 30, 60)


@pytest.fixture
def performer(addon: object, motion: Motion) -> str:
    return create_character.create_character(bpy.context, default_skeleton(1.9))


def export(performer: str, target: Path, kind: str, motion: Motion, **form: Any) -> int:
    return export_poses(bpy.context, performer, target, kind, motion, Form(**form))


def import_again(path: Path, kind: str) -> bpy.types.Object:
    """What an animator gets who imports the file with the importer's own settings."""
    known = set(bpy.data.objects)
    if kind == "BVH":
        bpy.ops.import_anim.bvh(filepath=str(path))
    elif kind == "FBX":
        bpy.ops.import_scene.fbx(filepath=str(path))
    else:
        bpy.ops.import_scene.gltf(filepath=str(path))
    return next(obj for obj in bpy.data.objects if obj not in known and obj.type == "ARMATURE")


def joints(obj: bpy.types.Object, first: float, count: int, names: list[str]) -> np.ndarray:
    """Positions (F, J, 3) of bone heads in the scene, frame after frame."""
    found = []
    for frame in first + np.arange(count):
        bpy.context.scene.frame_set(int(np.floor(frame)), subframe=float(frame - np.floor(frame)))
        posed = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found.append([np.array(posed.matrix_world @ posed.pose.bones[name].head) for name in names])
    return np.array(found)


def first_key(obj: bpy.types.Object) -> float:
    return min(key.co[0] for curve in curves_of(obj) for key in curve.keyframe_points)


@pytest.mark.parametrize("root_motion", ["HIPS", "OBJECT"])
def test_joints_of_an_imported_file_are_where_they_were(performer, motion, tmp_path, root_motion):
    obj, scene = bpy.data.objects[performer], bpy.context.scene
    obj.perfanim_character.root_motion = root_motion
    obj.location, obj.rotation_euler, obj.scale = (1.0, -2.0, 0.5), (0.3, -0.2, 0.7), (1.1, 1.1, 1.1)
    files = {kind: tmp_path / f"run{ending}" for kind, ending in ENDINGS.items()}
    for kind, target in files.items():
        assert export(performer, target, kind, motion) == motion.frames
    names = [bone.name for bone in obj.data.bones]
    scene.render.fps, scene.render.fps_base = round(motion.fps), 1.0
    frames = actions.scene_frames(np.arange(motion.frames) / motion.fps, scene)
    actions.write_action(performer, frames, motion.rotations, motion.root_positions_m, motion.skeleton)
    wanted = joints(obj, 1, motion.frames, names)
    assert np.linalg.norm(np.ptp(wanted[:, 0], axis=0)) > 0.3  # they move
    for kind, target in files.items():
        found = import_again(target, kind)
        assert {bone.name for bone in found.data.bones} == set(names)
        assert np.linalg.norm(joints(found, first_key(found), motion.frames, names) - wanted, axis=2).max() < SAME_M
        meshes = [other for other in bpy.data.objects if other.type == "MESH" and other.find_armature() == found]
        assert bool(meshes) == (kind != "BVH")
    read = read_bvh(files["BVH"])  # by the product, too
    assert (read.frames, read.fps) == (motion.frames, pytest.approx(motion.fps, abs=0.01))


@pytest.mark.parametrize(("kind", "naming"), [("BVH", "unreal"), ("FBX", "mixamo"), ("GLTF", "vrm")])
def test_joints_have_another_programs_names_and_are_where_they_were(performer, motion, tmp_path, kind, naming):
    """One bone that stands for no joint has a name that is needed."""
    obj, scene, names = bpy.data.objects[performer], bpy.context.scene, NAMINGS[naming]
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    spare = obj.data.edit_bones.new(names["lfemur"])
    spare.parent, spare.head, spare.tail = obj.data.edit_bones["head"], (0, 0, 2), (0, 0, 2.1)
    bpy.ops.object.mode_set(mode="OBJECT")
    before = [bone.name for bone in obj.data.bones]
    mesh = next(other for other in bpy.data.objects if other.type == "MESH" and other.find_armature() == obj)
    groups = [group.name for group in mesh.vertex_groups]
    target = tmp_path / f"run{ENDINGS[kind]}"
    count = export(performer, target, kind, motion, naming=naming, scale=100.0)
    assert count == motion.frames
    assert [bone.name for bone in obj.data.bones] == before
    assert [group.name for group in mesh.vertex_groups] == groups
    scene.render.fps, scene.render.fps_base = round(motion.fps), 1.0
    frames = actions.scene_frames(np.arange(motion.frames) / motion.fps, scene)
    actions.write_action(performer, frames, motion.rotations, motion.root_positions_m, motion.skeleton)
    joint_names = list(names)
    wanted = joints(obj, 1, count, list(NAMINGS["blender"].values()))
    found = import_again(target, kind)
    assert {bone.name for bone in found.data.bones} == {*names.values(), f"{names['lfemur']}_"}
    there = joints(found, first_key(found), count, [names[joint] for joint in joint_names])
    there *= 0.01 if kind == "BVH" else 1.0
    assert np.linalg.norm(there - wanted, axis=2).max() < SAME_M


def test_scene_and_armature_are_left_as_they_were(performer, motion, tmp_path):
    obj, scene = bpy.data.objects[performer], bpy.context.scene
    actions.write_action(performer, [1.0, 5.0], motion.rotations[:2], motion.root_positions_m[:2], motion.skeleton)
    bone = obj.pose.bones["hand.L"]
    bone.rotation_mode, bone.rotation_euler = "XYZ", (0.1, 0.2, 0.3)
    constraint = bone.constraints.new("IK")
    scene.frame_start, scene.frame_end, scene.render.fps = 3, 77, 25
    scene.frame_set(4)
    bpy.ops.object.mode_set(mode="POSE")
    curves = [[tuple(key.co) for key in curve.keyframe_points] for curve in curves_of(obj)]
    action = obj.animation_data.action
    for kind, ending in ENDINGS.items():
        export(performer, tmp_path / f"run{ending}", kind, motion, meshes=False)
        assert (scene.frame_start, scene.frame_end, scene.frame_current, scene.render.fps) == (3, 77, 4, 25)
        assert (bone.rotation_mode, constraint.mute, obj.mode) == ("XYZ", False, "POSE")
        np.testing.assert_allclose(bone.rotation_euler, (0.1, 0.2, 0.3), atol=1e-6)
        assert obj.animation_data.action == action
        assert [action.name for action in bpy.data.actions] == [action.name]
        assert [[tuple(key.co) for key in c.keyframe_points] for c in curves_of(obj)] == curves
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.bvh", "run.fbx", "run.glb"]


def test_what_cannot_be_exported_says_why_and_leaves_nothing(performer, motion, tmp_path, monkeypatch):
    bpy.data.objects[performer].hide_set(True)
    with pytest.raises(CharacterError, match="show it"):
        export(performer, tmp_path / "run.fbx", "FBX", motion)
    bpy.data.objects[performer].hide_set(False)
    import addon_utils

    addon_utils.disable("io_anim_bvh")
    try:
        with pytest.raises(FormatError, match="enable Blender's own BVH exporter"):
            export(performer, tmp_path / "run.bvh", "BVH", motion)
    finally:
        addon_utils.enable("io_anim_bvh")
    assert bpy.data.objects[performer].animation_data is None
    assert len(bpy.data.actions) == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ENDINGS)
@pytest.mark.parametrize("name", ["{}", ".{}", "%s{{}}{}", "walk.{}", "walk.2{}", " {}", "#{}", "{}{}"])
def test_any_name_becomes_one_whole_file(performer: str, motion: Motion, tmp_path: Path, kind: str, name: str) -> None:
    """Blender's exporters add their ending to a name without it, and write elsewhere than they were told."""
    target = tmp_path / name.format(*2 * (ENDINGS[kind],))
    assert export(performer, target, kind, sliced(motion, 0, 2)) == 2
    assert [path.name for path in tmp_path.iterdir()] == [target.name]
    assert target.stat().st_size > 1000
