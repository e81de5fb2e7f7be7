"""Characters of glTF files whose nodes place, turn and scale them: they move as the one without does."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from gltf_files import write_character
from heroes import clip
from perfanim.core.errors import FormatError
from perfanim.perfanim_addon.capture.armature_driver import ArmatureDriver
from perfanim.perfanim_addon.export.retarget_file import open_file, retarget_file

MOTION = clip("walking-01-neutral", 20)


def shown(path: Path, form: str = ".blend") -> tuple[np.ndarray, np.ndarray]:
    """Return bone heads (F, B, 3) in the scene, and corners (2, 3) of the mesh, after retargeting to a file."""
    out = path.with_suffix(f".out{form}")
    retarget_file(MOTION, path, out)
    if form == ".glb":
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.import_scene.gltf(filepath=str(out))
    scene = bpy.context.scene
    armature = next(each for each in scene.objects if each.type == "ARMATURE")
    heads = []
    for frame in range(1, MOTION.frames + 1):
        scene.frame_set(frame)
        heads.append([armature.matrix_world @ bone.head for bone in armature.pose.bones])
    mesh = next(each for each in scene.objects if each.type == "MESH" and each.find_armature() == armature)
    evaluated = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.array([evaluated.matrix_world @ vertex.co for vertex in evaluated.to_mesh().vertices])
    return np.array(heads), np.array([points.min(axis=0), points.max(axis=0)])


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    path = tmp_path_factory.mktemp("plain") / "plain.glb"
    write_character(path, {})
    return {form: shown(path, form) for form in (".blend", ".glb")}


@pytest.mark.parametrize("form", [".blend", ".glb"])
@pytest.mark.parametrize(
    ("scales", "turned", "arms_down"),
    [
        ({"Hips": 0.01}, False, False),
        ({"Hips": 100.0}, False, False),
        ({"Spine2": 0.5}, False, False),
        ({"Hips": 0.01, "Spine2": 2.0, "LeftArm": 0.5}, False, False),
        ({"Armature": 0.01}, False, False),
        ({"Armature": 0.01}, True, False),
        ({"Armature": 0.01, "Hips": 0.5}, True, False),
        ({"Armature": 0.01}, True, True),
    ],
)
def test_scaled_and_turned_nodes_change_nothing(
    tmp_path: Path, plain: Any, scales: dict[str, float], turned: bool, arms_down: bool, form: str
) -> None:
    write_character(tmp_path / "a.glb", scales, turned, arms_down)
    heads, corners = shown(tmp_path / "a.glb", form)
    right_heads, right_corners = plain[form]
    np.testing.assert_allclose(heads, right_heads, atol=2e-3)
    np.testing.assert_allclose(corners, right_corners, atol=2e-3)
    assert np.ptp(right_heads[0, :, 2]) == pytest.approx(1.54, abs=0.1)


def test_a_live_character_keeps_the_scale_of_its_bones(tmp_path: Path) -> None:
    heads = []
    for scales in ({}, {"Hips": 0.01}, {"Spine1": 2.0}):
        write_character(tmp_path / "a.glb", scales)
        open_file(tmp_path / "a.glb")
        armature = next(each for each in bpy.context.scene.objects if each.type == "ARMATURE")
        ArmatureDriver(armature.name, MOTION.skeleton).apply(MOTION.rotations[9], MOTION.root_positions_m[9])
        bpy.context.view_layer.update()
        heads.append(np.array([armature.matrix_world @ bone.head for bone in armature.pose.bones]))
    np.testing.assert_allclose(heads[1], heads[0], atol=1e-3)
    np.testing.assert_allclose(heads[2], heads[0], atol=1e-3)


def test_what_is_no_character_is_named(tmp_path: Path) -> None:
    page = tmp_path / "a.glb"
    page.write_bytes(b"<!DOCTYPE html><html></html>")
    with pytest.raises(FormatError, match=r"a.glb: is a web page, not the expected glTF file"):
        open_file(page)
