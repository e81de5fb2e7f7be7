"""Sketches in Blender: controls, their keys, the solved action, and what stays with the file."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from played import curves_of, key_times
from sketched import EVERY, MET, distances, key, sketch_of, solve

pytestmark = pytest.mark.usefixtures("near_worker")


def test_controls_stand_at_the_present_pose(part: Any, keyed: bpy.types.Object) -> None:
    controls = part("sketch.controls")
    for control in controls.controls_of(keyed).values():
        bpy.data.objects.remove(control)
    keyed.pose.bones["upper_arm.L"].rotation_quaternion = (0.8, 0.0, 0.6, 0.0)
    keyed.perfanim_sketch.parts = {"HANDS", "CHEST"}
    assert bpy.ops.perfanim.add_controls() == {"FINISHED"}
    found = controls.controls_of(keyed)
    assert sorted(found) == ["lhand", "rhand", "thorax"]
    assert {each.type for each in found.values()} == {"EMPTY"}
    assert all(keyed.perfanim_sketch.controls in each.users_collection for each in found.values())
    off = distances(part, keyed, [bpy.context.scene.frame_current])
    assert max(max(each) for each in off.values()) < 1e-4
    names = {each.name for each in found.values()}
    bpy.ops.perfanim.add_controls()
    assert {each.name for each in controls.controls_of(keyed).values()} == names  # those there stay


def test_controls_in_an_empty_file_come_with_a_character(part: Any) -> None:
    assert bpy.ops.perfanim.add_controls() == {"FINISHED"}
    armature = bpy.context.scene.perfanim.armature
    found = part("sketch.controls").controls_of(armature)
    assert sorted(found) == ["lfoot", "rfoot", "root"]
    assert {each.name for each in bpy.context.selected_objects} == {each.name for each in found.values()}
    assert 0.95 < found["root"].location.z < 1.05  # stands: a walk's hips are as high


def test_keys_are_read_as_they_were_set(part: Any, keyed: bpy.types.Object, walk: Motion) -> None:
    space = part("sketch.write_solution").SketchBody.of(keyed).space
    found = part("sketch.read_controls").read_controls(bpy.context, keyed, space)
    wanted = {each.joint: each for each in sketch_of(walk).controls}
    assert found.fps == 30.0
    assert sorted(each.joint for each in found.controls) == sorted(wanted)
    for each in found.controls:
        np.testing.assert_array_equal(each.frames, wanted[each.joint].frames)
        np.testing.assert_allclose(each.positions_m, wanted[each.joint].positions_m, atol=1e-5)


def test_the_body_meets_the_keys(part: Any, keyed: bpy.types.Object, walk: Motion) -> None:
    text = solve(part)
    assert "all keys are met" in text
    frames = sketch_of(walk).frames
    off = distances(part, keyed, frames[::EVERY])
    assert max(max(each) for each in off.values()) < MET
    np.testing.assert_array_equal(key_times(curves_of(keyed)), frames)
    assert keyed.animation_data.action == keyed.perfanim_sketch.action
    assert bpy.context.scene.frame_end >= frames[-1]


def test_a_foreign_character_meets_the_keys(part: Any, database: Path, mixamo_blend: Path, walk: Motion) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    scene = bpy.context.scene
    scene.render.fps = 30
    hero = bpy.data.objects["Hero"]
    hero.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    scene.perfanim.armature, scene.perfanim.database = hero, str(database)
    key(part, hero, walk)
    solve(part)
    off = distances(part, hero, sketch_of(walk).frames[::EVERY])
    assert max(np.mean(each) for each in off.values()) < 0.03  # at twice the size of a person


def test_impossible_keys_are_told(part: Any, keyed: bpy.types.Object) -> None:
    hand = part("sketch.controls").controls_of(keyed)["lhand"]
    hand.location.x += 3.0
    hand.keyframe_insert("location", frame=35)
    text = solve(part)
    assert "not met" in text
    assert "Hand L in frame 35 is" in text
    assert " m off" in text


def test_what_cannot_be_a_sketch_is_refused(part: Any, keyed: bpy.types.Object, errors: Any) -> None:
    controls = part("sketch.controls")
    space = part("sketch.write_solution").SketchBody.of(keyed).space
    root = controls.controls_of(keyed)["root"]
    root.location.x = 5000.0
    root.keyframe_insert("location", frame=20)
    with pytest.raises(errors.SettingsError, match="m from the character's origin"):
        part("sketch.read_controls").read_controls(bpy.context, keyed, space)
    root.animation_data_clear()
    root.location.x = 0.0
    for frame in (0, 30000):
        root.keyframe_insert("location", frame=frame)
    with pytest.raises(errors.SettingsError, match="at most"):
        part("sketch.read_controls").read_controls(bpy.context, keyed, space)
    for each in controls.controls_of(keyed).values():
        each.animation_data_clear()
    with pytest.raises(errors.SettingsError, match="no control has a key"):
        part("sketch.read_controls").read_controls(bpy.context, keyed, space)


def test_unknown_behaviours_are_told(part: Any, keyed: bpy.types.Object, errors: Any) -> None:
    keyed.perfanim_sketch.behaviours = "swimming"
    with pytest.raises(errors.PerfanimError, match="swimming"):
        solve(part)
    assert keyed.animation_data is None or keyed.animation_data.action is None


def test_baked_keys_are_few_and_near(part: Any, keyed: bpy.types.Object, walk: Motion) -> None:
    solve(part)
    every = sum(len(curve.keyframe_points) for curve in curves_of(keyed))
    solve(part, "PERFANIM_OT_bake_sketch")
    assert sum(len(curve.keyframe_points) for curve in curves_of(keyed)) < 0.5 * every
    off = distances(part, keyed, sketch_of(walk).frames[::EVERY])
    assert max(np.mean(each) for each in off.values()) < 0.02


def test_only_some_body_parts_get_keys(part: Any, keyed: bpy.types.Object) -> None:
    bpy.context.scene.perfanim.body_parts = {"ARM_L"}
    solve(part)
    groups = {curve.data_path.split('"')[1] for curve in curves_of(keyed)}
    assert {"upper_arm.L", "hand.L"} <= groups
    assert not {"upper_arm.R", "shin.L", "hips"} & groups


def test_a_saved_sketch_is_taken_up_again(part: Any, keyed: bpy.types.Object, walk: Motion, tmp_path: Path) -> None:
    keyed.perfanim_sketch.follow, keyed.perfanim_sketch.behaviours = 0.75, "walking"
    solve(part)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "sketch.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "sketch.blend"))
    armature = bpy.context.scene.perfanim.armature
    controls = part("sketch.controls")
    for control in controls.controls_of(armature).values():
        bpy.data.objects.remove(control)
    armature.perfanim_sketch.follow, armature.perfanim_sketch.behaviours = 0.0, ""
    assert bpy.ops.perfanim.take_up_sketch() == {"FINISHED"}
    assert armature.perfanim_sketch.follow == pytest.approx(0.75)
    assert armature.perfanim_sketch.behaviours == "walking"
    test_keys_are_read_as_they_were_set(part, armature, walk)
    for control in controls.controls_of(armature).values():  # default curves need no key more
        np.testing.assert_array_equal(key_times(curves_of(control)), sketch_of(walk).frames[::EVERY])


def test_a_rough_animation_becomes_keys_of_controls(part: Any, keyed: bpy.types.Object) -> None:
    for control in part("sketch.controls").controls_of(keyed).values():
        bpy.data.objects.remove(control)
    bone = keyed.pose.bones["upper_arm.L"]
    for frame, turn in ((1, 0.0), (20, 0.9), (31, 0.2)):
        bone.rotation_quaternion = (np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2))
        bone.keyframe_insert("rotation_quaternion", frame=frame)
    assert bpy.ops.perfanim.add_controls(from_action=True) == {"FINISHED"}
    for control in part("sketch.controls").controls_of(keyed).values():
        np.testing.assert_array_equal(key_times(curves_of(control)), [1, 20, 31])
    off = distances(part, keyed, [1, 20, 31])
    assert max(max(each) for each in off.values()) < 1e-4


def test_a_rough_animation_is_read_again_after_it_is_solved(part: Any, keyed: bpy.types.Object) -> None:
    controls, bone = part("sketch.controls"), keyed.pose.bones["upper_arm.L"]
    for frame in (1, 31):
        bone.keyframe_insert("rotation_quaternion", frame=frame)
    rough = keyed.animation_data.action
    assert bpy.ops.perfanim.add_controls(from_action=True) == {"FINISHED"}
    solve(part)
    solved = keyed.animation_data.action
    assert solved != rough
    keyed.perfanim_sketch.free_height = True
    bpy.context.scene.frame_set(20)
    assert bpy.ops.perfanim.add_controls(from_action=True) == {"FINISHED"}
    for control in controls.controls_of(keyed).values():
        np.testing.assert_array_equal(key_times(curves_of(control)), [1, 31])  # those by hand went the first time
    assert keyed.animation_data.action == solved
    assert not keyed.perfanim_sketch.free_height
    assert bpy.context.scene.frame_current == 20
    keyed.perfanim_sketch.rough = None
    with pytest.raises(RuntimeError, match="is a solved sketch, not a rough action"):
        bpy.ops.perfanim.add_controls(from_action=True)


def test_sides_have_colours_of_their_own(part: Any) -> None:
    colour_of = part("sketch.control_colours").colour_of
    assert colour_of("lhand") == colour_of("ltoes") != colour_of("rhand") == colour_of("rfoot")
    middle = colour_of("root")
    assert middle == colour_of("lowerback") == colour_of("head")
    assert middle not in (colour_of("lhand"), colour_of("rhand"))


@pytest.mark.parametrize("onto", ["STRIP", "LAYER"])
def test_a_sketch_goes_above_other_animation(part: Any, keyed: bpy.types.Object, walk: Motion, onto: str) -> None:
    keyed.pose.bones["upper_arm.L"].keyframe_insert("rotation_quaternion", frame=1)
    own = keyed.animation_data.action
    bpy.context.scene.perfanim_result.onto = onto
    assert "all keys are met" in solve(part)
    strips = [each for track in keyed.animation_data.nla_tracks for each in track.strips]
    assert [each.action for each in strips] == [own, keyed.perfanim_sketch.action]
    frames = sketch_of(walk).frames
    assert (strips[1].frame_start, strips[1].frame_end) == (frames[0], frames[-1])
    assert (strips[1].blend_in > 0.0) == (onto == "LAYER")
    off = distances(part, keyed, frames[2 * EVERY : -2 * EVERY : EVERY])  # where it is blended in
    assert max(max(each) for each in off.values()) < MET


def test_behaviours_are_chosen_from_those_of_the_database(part: Any, keyed: bpy.types.Object) -> None:
    listed = [item[0] for item in part("operators.sketch_operators")._listed(bpy.context)]
    assert listed[:2] == ["walking", "walking brisk"]
    assert len(listed) == 5
    for name in ("walking brisk", "walking neutral", "walking brisk"):
        assert bpy.ops.perfanim.add_behaviour(behaviour=name) == {"FINISHED"}
    chosen = keyed.perfanim_sketch
    assert chosen.solver_settings().behaviours == ("walking brisk*", "walking neutral*")
    assert bpy.ops.perfanim.remove_behaviour(behaviour="walking neutral") == {"FINISHED"}
    assert chosen.solver_settings().behaviours == ("walking brisk*",)
    bpy.ops.perfanim.remove_behaviour(behaviour="walking brisk")
    assert chosen.solver_settings().behaviours == ()


def test_a_damaged_database_lists_nothing(part: Any, keyed: bpy.types.Object, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.pfdb"
    damaged.write_bytes(b"PERFANIM-DB")
    bpy.context.scene.perfanim.database = str(damaged)
    assert part("operators.sketch_operators")._listed(bpy.context) == []


def test_motion_paths_come_and_go(part: Any, keyed: bpy.types.Object) -> None:
    controls = list(part("sketch.controls").controls_of(keyed).values())
    for selected in (True, False):
        for each in controls:
            each.select_set(selected)
        assert bpy.ops.perfanim.show_motion_paths() == {"FINISHED"}
        assert all((each.motion_path is not None) == selected for each in controls)
    assert keyed.motion_path is None
