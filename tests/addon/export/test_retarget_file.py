"""A motion on the character of a file: programs in it are not run, and each output is one file of its kind."""

from pathlib import Path

import bpy
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon.export import retarget_file, stage


@pytest.mark.parametrize("trusting", [False, True])
def test_a_characters_programs_are_not_run(tmp_path: Path, trusting: bool) -> None:
    ran = tmp_path / "ran"
    bpy.ops.wm.read_factory_settings(use_empty=True)
    text = bpy.data.texts.new("harmful.py")
    text.write(f"open({str(ran)!r}, 'w').close()")
    text.use_module = True  # runs when the file is opened by somebody who trusts it
    bone = bpy.data.objects.new("object", None)
    driver = bone.driver_add("location", 0).driver
    driver.expression = f"open({str(ran)!r}, 'w').close() or 1.0"
    bpy.context.scene.collection.objects.link(bone)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "character.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = trusting
    try:
        retarget_file.open_file(tmp_path / "character.blend")
        assert "harmful.py" in bpy.data.texts
        bpy.context.view_layer.update()
        assert not ran.exists()
    finally:
        bpy.context.preferences.filepaths.use_scripts_auto_execute = False


@pytest.mark.parametrize(
    ("name", "begins"), [(".glb", b"glTF"), ("{walk}#.glb", b"glTF"), (".blend", b"\x28\xb5\x2f\xfd")]
)
def test_outputs_have_the_names_that_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, begins: bytes
) -> None:
    monkeypatch.setattr(stage, "_STAGE", stage.Stage(pixels=(48, 64), samples=1))
    motion = sliced(read_motion(next(MOTION.glob("running-01*.bvh"))), 0, 4)
    picture = retarget_file.Picture(tmp_path / "{walk}#.png", 2)
    retarget_file.retarget_file(motion, None, tmp_path / name, picture=picture)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted((name, "{walk}#.png"))
    assert (tmp_path / name).read_bytes()[:4] == begins
    assert (tmp_path / "{walk}#.png").read_bytes()[:4] == b"\x89PNG"
