"""What is asked of Blender's process; tests/addon has the characters."""

from pathlib import Path

import perfanim
import pytest
from perfanim.core.api import retargeting
from perfanim.core.retarget.retargeter import RootMotion


@pytest.fixture
def asked(monkeypatch):
    """The calls of Blender's process, each with its motion's frames."""
    calls = []

    def run(entry, arguments, blender):
        calls.append((entry, arguments[1:], blender, perfanim.load_motion(Path(arguments[0])).frames))
        return {"mapped": 1}

    monkeypatch.setattr(retargeting, "run_in_blender", run)
    monkeypatch.setattr(retargeting, "check_blender", lambda blender: None)
    return calls


def test_motion_is_handed_over_as_a_file_and_none_is_left(truth, asked, tmp_path):
    request = perfanim.RetargetRequest(
        "hero.glb", picture="walk.png", frame=3, root_motion=RootMotion.ROOT_BONE, blender="/usr/bin/blender"
    )
    assert perfanim.retarget(truth, tmp_path / "walk.blend", request) == {"mapped": 1}
    given = [str(tmp_path / "walk.blend"), "--to", "hero.glb", "--render", "walk.png", "--frame", "3"]
    given += ["--root-motion", "root_bone"]
    assert asked == [("perfanim.perfanim_addon.export.retarget_file:main", given, "/usr/bin/blender", truth.frames)]
    assert list(tmp_path.iterdir()) == []


def test_scene_that_cannot_be_written_is_refused(truth, asked, tmp_path):
    with pytest.raises(perfanim.PerfanimError, match=r"use one of \.blend, \.fbx, \.glb, \.bvh"):
        perfanim.retarget(truth, tmp_path / "walk.obj", perfanim.RetargetRequest("hero.glb"))
    assert asked == []


def test_missing_blender_is_named(truth, tmp_path):
    with pytest.raises(perfanim.PerfanimError, match="gone: is not an executable"):
        perfanim.retarget(truth, tmp_path / "walk.blend", perfanim.RetargetRequest(blender=str(tmp_path / "gone")))
