"""FBX of a rig whose root bone ends at the hips: the file has the hips' motion, which Blender's importer hides."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from heroes import at_24_fps, clip, save_hero
from perfanim.perfanim_addon.export.retarget_file import retarget_file
from retargeted import played

FRAMES, JOINT_M = 30, 1e-3


@pytest.fixture
def rooted(tmp_path: Path) -> Path:
    """Hero with a root bone below the hips, which are not connected to it."""
    path = tmp_path / "rooted.blend"
    save_hero(path)
    hero = bpy.data.objects["Hero"]
    bpy.context.view_layer.objects.active = hero
    bpy.ops.object.mode_set(mode="EDIT")
    bones = hero.data.edit_bones
    hips, root = bones["mixamorig:Hips"], bones.new("root")
    root.head, root.tail = (hips.head.x, hips.head.y, 0.0), hips.head
    hips.parent = root
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def places(armature_object: bpy.types.Object, names: list[str]) -> np.ndarray:
    return np.array([each[:, :3, 3] for each in played(armature_object, FRAMES, names).values()])


def test_the_hips_move_once_they_are_not_connected(rooted: Path, tmp_path: Path) -> None:
    motion, target = at_24_fps(clip("walking-01-neutral", FRAMES)), tmp_path / "walk.fbx"
    done = retarget_file(motion, rooted, target)
    names = [done["mapped"][joint] for joint in ("root", "head", "lhand", "rfoot")]
    wanted = places(bpy.data.objects[done["armature"]], names)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 24
    bpy.ops.import_scene.fbx(filepath=str(target), anim_offset=0.0)
    (read,) = [each for each in bpy.data.objects if each.type == "ARMATURE"]
    assert read.data.bones["mixamorig:Hips"].use_connect
    bpy.context.view_layer.objects.active = read
    bpy.ops.object.mode_set(mode="EDIT")
    read.data.edit_bones["mixamorig:Hips"].use_connect = False
    bpy.ops.object.mode_set(mode="OBJECT")
    np.testing.assert_allclose(places(read, names), wanted, atol=JOINT_M)
