"""Blender's own properties of an operator hide methods of the same name."""

from typing import Any

import bpy
import pytest


def test_no_method_has_the_name_of_a_property_of_blender(part: Any) -> None:
    """`self.options` is Blender's, whatever the class defines: Import Motion failed at the click."""
    owned = {each.identifier for each in bpy.types.Operator.bl_rna.properties}
    assert "options" in owned
    waiting, seen = [part("operators.operator_bases").CheckedOperator], set()
    while waiting:
        cls = waiting.pop()
        seen.add(cls.__name__)
        waiting += cls.__subclasses__()
        assert not {name for name, value in vars(cls).items() if callable(value)} & owned, cls
    assert "PERFANIM_OT_build_database" in seen


def test_a_profile_for_a_target_that_is_gone_is_refused(part: Any) -> None:
    assert bpy.ops.perfanim.average_performer("EXEC_DEFAULT") == {"FINISHED"}
    with pytest.raises(RuntimeError, match="the chosen target was removed; choose another in the list"):
        bpy.ops.perfanim.use_profile("EXEC_DEFAULT", target=0)
    bpy.ops.perfanim.add_target("EXEC_DEFAULT")
    assert bpy.ops.perfanim.use_profile("EXEC_DEFAULT", target=0) == {"FINISHED"}
    assert bpy.context.scene.perfanim_targets.entries[0].subject.endswith(".toml")


def test_motion_is_imported_at_a_click(part: Any, tmp_path: Any) -> None:
    (tmp_path / "walk.bvh").write_bytes(b"")
    ended = bpy.ops.perfanim.build_database("EXEC_DEFAULT", filepath=str(tmp_path / "walk.bvh"))
    assert ended == {"RUNNING_MODAL"}
    assert part("jobs.activity").current().title == "Importing motion"
    bpy.ops.perfanim.cancel_job("EXEC_DEFAULT")


def test_names_that_no_file_can_have_are_not_found(part: Any, tmp_path: Any) -> None:
    """`Path.exists` and `is_file` raise for them."""
    name = "x" * 300
    for operator in (bpy.ops.perfanim.build_database, bpy.ops.perfanim.import_takes):
        with pytest.raises(RuntimeError, match="not found; choose"):
            operator("EXEC_DEFAULT", filepath=str(tmp_path / name))
    chosen = bpy.context.scene.perfanim
    chosen.subject_take = chosen.board_left = chosen.board_right = chosen.left_video = chosen.right_video = f"/{name}"
    chosen.source = "VIDEOS"
    for operator in (bpy.ops.perfanim.calibrate_subject, bpy.ops.perfanim.calibrate_cameras):
        with pytest.raises(RuntimeError, match=r"not found|is not a folder"):
            operator("EXEC_DEFAULT")
    assert part("settings.readiness").pictures(chosen).text == "left not found"
    batch = bpy.context.scene.perfanim_batch
    batch.takes = f"/{name}"
    assert part("settings.batch_settings").problem(batch) == "folder of takes not found"


def test_an_object_without_bones_is_no_character(part: Any) -> None:
    """Blender asks `poll` for choices by hand only, not for those of a script."""
    mesh = bpy.data.objects.new("Mesh", bpy.data.meshes.new("Mesh"))
    bpy.context.scene.collection.objects.link(mesh)
    bpy.ops.perfanim.add_target("EXEC_DEFAULT")
    for chosen in (bpy.context.scene.perfanim, bpy.context.scene.perfanim_targets.entries[0]):
        chosen.armature = mesh
        assert chosen.armature is None
