"""The bone map in the add-on."""

from typing import Any

import bpy
import numpy as np
import pytest


def test_the_map_is_found_when_an_armature_is_chosen_and_can_be_edited(part: Any, chosen: Any, hero: Any) -> None:
    states, kept = part("settings.readiness"), hero.perfanim_character
    assert kept.origin == "names"
    entry = kept.joints["lhand"]
    assert (entry.bone, entry.state) == ("mixamorig:LeftHand", "mapped")
    entry.bone = "mixamorig:LeftForeArm"
    assert kept.joints["lhand"].state == "doubtful"
    assert "lradius" in kept.joints["lhand"].reason
    chosen.armature = None
    chosen.armature = hero
    assert kept.joints["lhand"].bone == "mixamorig:LeftForeArm"
    assert states.character(chosen).ready
    kept.joints["lfemur"].bone = ""
    assert "no bone is given for Thigh L" in states.character(chosen).problem
    assert len(kept.joints) == 29  # still there to be mended
    kept.joints["lfemur"].bone = "mixamorig:LeftUpLeg"
    assert states.character(chosen).ready
    assert bpy.ops.perfanim.find_bones() == {"FINISHED"}
    assert hero.perfanim_character.joints["lhand"].state == "mapped"


def test_use_active_finds_the_armature_of_what_an_importer_leaves_active(chosen: Any, hero: Any) -> None:
    layer = bpy.context.view_layer
    group, part = (bpy.data.objects.new(name, None) for name in ("Group", "Part"))
    for empty in (group, part):
        bpy.context.scene.collection.objects.link(empty)
    hero.parent, part.parent = group, hero
    for active in (bpy.data.objects["Hero body"], group, part):
        layer.objects.active, chosen.armature = active, None
        assert bpy.ops.perfanim.use_active_armature() == {"FINISHED"}
        assert chosen.armature == hero
    second = bpy.data.objects.new("Second", hero.data)
    bpy.context.scene.collection.objects.link(second)
    second.parent, layer.objects.active = group, group
    with pytest.raises(RuntimeError, match="Group has 2 armatures"):
        bpy.ops.perfanim.use_active_armature()


def test_bone_maps_are_kept_and_loaded(chosen: Any, hero: Any) -> None:
    kept = hero.perfanim_character
    kept.joints["head"].bone = "mixamorig:Neck1"
    assert bpy.ops.perfanim.save_bone_map(name="Long neck") == {"FINISHED"}
    kept.joints["head"].bone = "mixamorig:Head"
    assert bpy.ops.perfanim.load_bone_map(preset="Long_neck") == {"FINISHED"}
    assert kept.joints["head"].bone == "mixamorig:Neck1"
    chosen.armature = None
    kept.joints.clear()
    chosen.armature = hero  # what the user has kept for a rig comes before what is found
    assert (kept.origin, kept.joints["head"].bone) == ("Long_neck", "mixamorig:Neck1")


def test_the_active_bone_is_picked(chosen: Any, hero: Any) -> None:
    kept = hero.perfanim_character
    kept.active = list(kept.joints.keys()).index("head")
    hero.data.bones.active = hero.data.bones["mixamorig:Neck"]
    assert bpy.ops.perfanim.pick_bone() == {"FINISHED"}
    assert kept.joints["head"].bone == "mixamorig:Neck"


def test_the_t_pose_shows_whether_limbs_are_mapped_right(chosen: Any, hero: Any) -> None:
    bones = {entry.name: entry.bone for entry in hero.perfanim_character.joints}

    def way(start: str, end: str) -> np.ndarray:
        posed = hero.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
        heads = [np.array(hero.matrix_world @ posed[bones[joint]].head) for joint in (start, end)]
        return (heads[1] - heads[0]) / np.linalg.norm(heads[1] - heads[0])

    for bone in hero.pose.bones:  # somehow
        bone.rotation_mode = "QUATERNION"
        bone.rotation_quaternion = (0.9, 0.3, -0.2, 0.2)
    assert bpy.ops.perfanim.show_t_pose() == {"FINISHED"}
    for start, end, wanted in (
        ("lhumerus", "lradius", (1.0, 0.0, 0.0)),
        ("rradius", "rhand", (-1.0, 0.0, 0.0)),
        ("lfemur", "ltibia", (0.0, 0.0, -1.0)),
        ("rtibia", "rfoot", (0.0, 0.0, -1.0)),
    ):
        assert np.degrees(np.arccos(way(start, end) @ wanted)) < 12.0, start  # thighs stand apart a little
