"""A motion file becomes a Blender file with a new character, in a process of its own as the command line starts it."""

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry import rotations as rot
from perfanim.perfanim_addon.export.retarget_file import main
from played import played_poses

SKELETON = default_skeleton(1.7)


def export(*arguments: Path | str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "perfanim.perfanim_addon.export.retarget_file", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture
def motion(tmp_path) -> Motion:
    vectors = 0.4 * np.sin(0.2 * np.arange(25)[:, None, None] + np.random.default_rng(2).normal(size=(29, 3)))
    roots = np.stack((np.zeros(25), np.full(25, 0.95), 0.02 * np.arange(25)), axis=1)
    made = Motion("swing", 50.0, SKELETON, rot.from_rotation_vector(vectors), roots)
    write_bvh(made, tmp_path / "swing.bvh")
    return made


def test_the_file_holds_the_motion(motion, tmp_path):
    done = export(tmp_path / "swing.bvh", tmp_path / "out.blend")
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.blend", "swing.bvh"]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end, scene.render.fps / scene.render.fps_base) == (1, 25, 50.0)
    assert {obj.type for obj in scene.objects} == {"ARMATURE", "MESH", "LIGHT", "CAMERA"}
    found, roots = played_poses("Performer", 1.0 + np.arange(25), SKELETON)
    assert np.max(np.degrees(rot.angle_between(found, motion.rotations))) < 0.01
    assert np.max(np.abs(roots - motion.root_positions_m)) < 1e-4


def test_bad_input_is_one_line_and_no_file(motion, tmp_path, capsys):
    assert main([str(tmp_path / "missing.bvh"), str(tmp_path / "out.blend")]) == 1
    assert capsys.readouterr().err.startswith("retarget_file: ")
    done = export(tmp_path / "swing.bvh", tmp_path / "out.blend", "--frame", "99")
    assert done.returncode == 1
    assert done.stderr.startswith("retarget_file: ")
    assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["swing.bvh"]
