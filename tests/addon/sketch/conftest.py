"""A character with a walk's keys on its controls, and clips to draw from."""

from pathlib import Path
from typing import Any

import bpy
import pytest
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.cli.main import main
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.system.assets import MOTION
from sketched import key


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Walking clips without the one that is sketched."""
    clips = [str(path) for path in sorted(MOTION.glob("walking-*.bvh"))[1:5]]
    out = tmp_path_factory.mktemp("database") / "walks.pfdb"
    assert main(["database", "build", *clips, "--fps", "30", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def walk() -> Motion:
    return sliced(resampled(read_motion(sorted(MOTION.glob("walking-*.bvh"))[0]), 30.0), 0, 61)


@pytest.fixture
def keyed(part: Any, database: Path, walk: Motion) -> bpy.types.Object:
    """A character, moved and turned in the scene, with the walk's keys on five controls, from frame 11 on."""
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 30, 1.0
    scene.perfanim.database = str(database)
    name = part("character.create_character").create_character(bpy.context, walk.skeleton)
    armature = bpy.data.objects[name]
    armature.location, armature.rotation_mode = (2.0, -1.0, 0.0), "XYZ"
    armature.rotation_euler = (0.0, 0.0, 0.7)
    bpy.context.view_layer.update()
    scene.perfanim.armature = armature
    key(part, armature, walk)
    return armature
