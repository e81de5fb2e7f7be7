"""Characters of others: a `.blend` that holds programs is opened without running them."""

from pathlib import Path

import bpy
import pytest
from perfanim.perfanim_addon.export import retarget_file


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
