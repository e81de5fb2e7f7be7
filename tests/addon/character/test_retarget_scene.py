"""Characters as the scene has them: scaled, constrained, linked, animated before; live poses and recorded ones."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from heroes import clip, open_hero
from mathutils import Matrix
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import CharacterError
from perfanim.core.retarget.retargeter import RootMotion
from perfanim.perfanim_addon.animation.actions import write_action
from perfanim.perfanim_addon.capture.armature_driver import ArmatureDriver
from perfanim.perfanim_addon.character import create_character
from played import curves_of
from retargeted import played


@pytest.mark.parametrize("root_motion", list(RootMotion))
def test_live_poses_are_the_recorded_ones(part: Any, chosen: Any, hero: Any, root_motion: RootMotion) -> None:
    hero.location, hero.rotation_euler, hero.scale = (1.0, 2.0, 0.5), (0.0, 0.0, 0.7), (2.0, 2.0, 2.0)
    hero.perfanim_character.root_motion = root_motion.name
    motion = clip("boxing-01-neutral", 8)
    poses = motion.rotations, motion.root_positions_m, motion.skeleton
    part("animation.actions").write_action("Hero", np.arange(1.0, 9.0), *poses)
    recorded = played(hero, 8, [bone.name for bone in hero.pose.bones])
    hero.animation_data.action = None
    driver = part("capture.armature_driver").ArmatureDriver("Hero", motion.skeleton)
    for frame in range(8):
        driver.apply(motion.rotations[frame], motion.root_positions_m[frame])
        bpy.context.view_layer.update()
        for bone in hero.pose.bones:
            live = np.array(hero.matrix_world @ bone.matrix)
            assert np.allclose(live, recorded[bone.name][frame], atol=1e-4), bone.name


def stood(hero: bpy.types.Object, own: tuple, above: tuple) -> None:
    """Give a character a scale and a turned parent with a scale of its own."""
    parent = bpy.data.objects.new("Group", None)
    bpy.context.scene.collection.objects.link(parent)
    hero.parent = parent
    parent.location, parent.rotation_euler, parent.scale = (0.3, -1.0, 0.0), (0.4, -0.3, 0.7), above
    hero.location, hero.rotation_euler, hero.scale = (1.0, 2.0, 0.5), (0.2, 0.5, -0.4), own
    bpy.context.view_layer.update()


@pytest.mark.parametrize(
    ("own", "above", "said"),
    [
        ((1.0, 1.0, 2.0), (1.0, 1.0, 1.0), "non-uniform scale, 2 times larger"),
        ((1.0, 1.0, 1.0), (3.0, 1.0, 1.0), "non-uniform scale, 3 times larger"),
        ((-1.0, 1.0, 1.0), (1.0, 1.0, 1.0), "a negative scale mirrors it"),
        ((2.0, 2.0, 2.0), (-1.0, -1.0, -1.0), "a negative scale mirrors it"),
    ],
)
def test_a_character_that_the_scene_shows_distorted_is_refused_with_what_to_do(
    part: Any, chosen: Any, hero: Any, own: tuple, above: tuple, said: str
) -> None:
    hero.perfanim_character.joints["head"].bone = "mixamorig:Neck1"  # by hand
    stood(hero, own, above)
    assert said in part("settings.readiness").character(chosen).problem
    chosen.armature = hero
    assert hero.perfanim_character.joints["head"].bone == "mixamorig:Neck1"
    for name in ("Hero", create_character.create_character(bpy.context, default_skeleton())):
        obj = bpy.data.objects[name]
        obj.parent, obj.matrix_basis = hero.parent, hero.matrix_basis
        bpy.context.view_layer.update()
        with pytest.raises(CharacterError, match=rf"{name}: .*{said}.*Object > Apply > Scale"):
            ArmatureDriver(name, default_skeleton())


@pytest.mark.parametrize("root_motion", list(RootMotion))
@pytest.mark.parametrize("own", [(1.5, 1.5, 1.5), (-1.5, 1.5, -1.5)])
def test_joints_are_where_the_scene_s_scale_puts_them(
    part: Any, hero: Any, own: tuple, root_motion: RootMotion
) -> None:
    """As on the character without scale and place, brought into the scene as a whole; two negative scales turn it."""
    motion, drivers = clip("boxing-01-neutral", 8), part("capture.armature_driver")
    hero.perfanim_character.root_motion = root_motion.name

    def joints() -> np.ndarray:
        drivers.ArmatureDriver("Hero", motion.skeleton).apply(motion.rotations[7], motion.root_positions_m[7])
        bpy.context.view_layer.update()
        return np.array([hero.matrix_world @ bone.head for bone in hero.pose.bones])

    hero.data.transform(Matrix.Rotation(0.5, 4, "X"))  # its own up is not the scene's
    alone = joints()
    hero.delta_location, hero.delta_rotation_quaternion = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    stood(hero, own, (0.2, 0.2, 0.2))
    place = np.array(hero.matrix_world)
    assert np.allclose(joints(), alone @ place[:3, :3].T + place[:3, 3], atol=1e-4)


def test_lengths_and_joints_that_an_earlier_animation_has_left_are_brought_to_rest(mixamo_blend: Path) -> None:
    """As importers leave the pose of one of the animations in a file."""
    motion, shown = clip("boxing-01-neutral", 2), []
    for left in (False, True):
        for live in (False, True):
            hero = open_hero(mixamo_blend)
            for name in ("LeftUpLeg", "RightForeArm", "Hips", "Spine1") if left else ():
                bone = hero.pose.bones[f"mixamorig:{name}"]
                bone.scale, bone.location = (1.0, 1.1, 0.9), (0.02, 0.01, -0.03)
            if live:
                ArmatureDriver("Hero", motion.skeleton).apply(motion.rotations[1], motion.root_positions_m[1])
            else:
                write_action("Hero", [1.0, 2.0], motion.rotations, motion.root_positions_m, motion.skeleton)
                bpy.context.scene.frame_set(2)
            bpy.context.view_layer.update()
            shown.append([np.array(bone.matrix) for bone in hero.pose.bones])
    for other in shown[1:]:
        assert np.allclose(shown[0], other, atol=1e-5)


def hold(hero: Any, bone: str, kind: str) -> Any:
    """Constrain a bone to an empty; return the constraint."""
    constraint = hero.pose.bones[f"mixamorig:{bone}"].constraints.new(kind)
    constraint.target = bpy.data.objects.new("holder", None)
    bpy.context.scene.collection.objects.link(constraint.target)
    return constraint


def test_inverse_kinematics_does_not_pull_against_the_motion(mixamo_blend: Path) -> None:
    motion, shown = clip("boxing-01-neutral", 8), []
    for with_ik in (False, True):
        hero = open_hero(mixamo_blend)
        if with_ik:
            hold(hero, "LeftForeArm", "IK").chain_count = 2
        ArmatureDriver("Hero", motion.skeleton).apply(motion.rotations[5], motion.root_positions_m[5])
        bpy.context.view_layer.update()
        shown.append([np.array(bone.matrix) for bone in hero.pose.bones])
    assert np.allclose(shown[0], shown[1], atol=1e-5)


def test_a_held_bone_is_told(hero: Any) -> None:
    hold(hero, "LeftHand", "COPY_ROTATION")
    with pytest.raises(CharacterError, match="constraints hold the bone 'mixamorig:LeftHand'"):
        ArmatureDriver("Hero", default_skeleton())


def test_a_linked_rig_is_driven_through_its_override(part: Any, mixamo_blend: Path, tmp_path: Path) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(mixamo_blend), link=True) as (_, wanted):
        wanted.objects = ["Hero"]
    linked = bpy.data.objects["Hero"]
    bpy.context.scene.collection.objects.link(linked)
    chosen, states = bpy.context.scene.perfanim, part("settings.readiness")
    chosen.armature = linked
    assert "make a library override" in states.character(chosen).problem
    own = linked.override_hierarchy_create(bpy.context.scene, bpy.context.view_layer, do_fully_editable=True)
    chosen.armature = own
    assert states.character(chosen).ready
    motion = clip("boxing-01-neutral", 4)
    poses = motion.rotations, motion.root_positions_m, motion.skeleton
    part("animation.actions").write_action(own.name, np.arange(1.0, 5.0), *poses)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    again = bpy.context.scene.perfanim.armature
    assert again.override_library is not None
    assert states.character(bpy.context.scene.perfanim).ready
    assert len(curves_of(again)) > 100
