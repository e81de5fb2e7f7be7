"""Controls that go with the bones of a roughly animated rig."""

from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler
from perfanim.core.body.motion import Motion
from played import curves_of
from sketched import MET, distances, play, played_live, solve

FRAMES = (11, 23, 41)


@pytest.fixture
def rough(part: Any, keyed: bpy.types.Object, walk: Motion) -> bpy.types.Object:
    """The character, with a rough action of three poses of the walk in place of keyed controls."""
    for control in part("sketch.controls").controls_of(keyed).values():
        bpy.data.objects.remove(control)
    bpy.context.view_layer.update()
    at = np.array(FRAMES) - FRAMES[0]
    poses = walk.rotations[at], walk.root_positions_m[at], walk.skeleton
    part("animation.actions").write_action(keyed.name, FRAMES, *poses, name="Rough")
    bpy.context.scene.frame_set(31)
    keyed.pose.bones["forearm.L"].keyframe_insert("rotation_quaternion", frame=31)  # of one limb alone
    keyed.perfanim_sketch.parts = {"HANDS", "FEET", "HIPS"}
    return keyed


def follow(part: Any, armature: bpy.types.Object) -> bpy.types.Object:
    """Let controls go with a copy of the character; return it."""
    for each in bpy.context.view_layer.objects:
        each.select_set(False)
    assert bpy.ops.perfanim.follow_rig() == {"FINISHED"}
    rig = bpy.context.view_layer.objects.active
    assert rig != armature
    assert rig.animation_data.action == armature.animation_data.action
    return rig


def test_keys_of_bones_bind(part: Any, rough: bpy.types.Object) -> None:
    rig = follow(part, rough)
    space = part("sketch.write_solution").SketchBody.of(rough).space
    read = part("sketch.read_controls").read_controls(bpy.context, rough, space)
    frames = {each.joint: each.frames.tolist() for each in read.controls}
    assert frames["lhand"] == [11, 23, 31, 41]
    assert frames["root"] == frames["rhand"] == frames["rfoot"] == list(FRAMES)
    assert "all keys are met" in solve(part)
    assert rough.animation_data.action != rig.animation_data.action  # the rough one stays as it is
    off = distances(part, rough, FRAMES)
    assert max(max(each) for each in off.values()) < MET


def test_keys_of_bones_are_known_without_a_change_of_frame(part: Any, rough: bpy.types.Object) -> None:
    arm, leg = (rough.pose.bones[name] for name in ("upper_arm.L", "thigh.R"))
    arm.rotation_mode, leg.rotation_mode = "XZY", "AXIS_ANGLE"
    for frame, angle in zip(FRAMES, (0.1, 0.7, -0.3), strict=True):
        arm.rotation_euler, leg.rotation_axis_angle = (angle, 0.5, 1.0), (angle, 0.5, 1.0, 0.2)
        arm.keyframe_insert("rotation_euler", frame=frame)
        leg.keyframe_insert("rotation_axis_angle", frame=frame)
    follow(part, rough)
    space = part("sketch.write_solution").SketchBody.of(rough).space
    reader = part("sketch.read_controls").read_controls
    bpy.context.scene.frame_set(23)
    shown = reader(bpy.context, rough, space)
    known = reader(bpy.context, rough, space, dragged=True)
    assert bpy.context.scene.frame_current == 23
    for one, other in zip(shown.controls, known.controls, strict=True):
        np.testing.assert_array_equal(one.frames, other.frames)
        np.testing.assert_allclose(one.positions_m, other.positions_m, atol=2e-5)
        np.testing.assert_allclose(one.drawn_m, other.drawn_m, atol=2e-5)


def test_live_follows_a_bone_that_is_posed_and_keyed(part: Any, rough: bpy.types.Object) -> None:
    rig = follow(part, rough)
    bpy.context.scene.frame_set(17)
    solve(part)
    with played_live(part) as live:
        play(part)
        bone = rig.pose.bones["upper_arm.L"]
        bone.rotation_quaternion @= Euler((0.0, 0.0, 0.1)).to_quaternion()
        bpy.context.view_layer.update()
        assert live.current().noted
        play(part)
        stored, _ = part("sketch.write_solution").kept_sketch(rough.perfanim_sketch.action)
        hand = next(each for each in stored.controls if each.joint == "lhand")
        assert hand.frames.tolist() == [11, 17, 23, 31, 41]  # posed, not keyed yet
        bpy.context.view_layer.update()  # as a redraw does
        bones = part("character.retarget_plans").bones_of(rough)
        ours, theirs = (each.matrix_world @ each.pose.bones[bones["lhand"]].head for each in (rough, rig))
        assert (ours - theirs).length < MET
        for curve in curves_of(rig):
            (key,) = (each for each in curve.keyframe_points if each.co.x == FRAMES[1])
            key.co.x += 4
            curve.update()
        rig.animation_data.action.update_tag()  # as Blender's editors do
        bpy.context.view_layer.update()
        assert live.current().noted
        play(part)
        stored, _ = part("sketch.write_solution").kept_sketch(rough.perfanim_sketch.action)
        assert all(FRAMES[1] + 4 in each.frames for each in stored.controls)


def test_a_bone_below_a_constraint_is_known_only_where_it_is_shown(part: Any, rough: bpy.types.Object) -> None:
    rig = follow(part, rough)
    rig.pose.bones["forearm.L"].constraints.new("LIMIT_ROTATION")
    space = part("sketch.write_solution").SketchBody.of(rough).space
    reader = part("sketch.read_controls").read_controls
    seen = {each.joint: each for each in reader(bpy.context, rough, space).controls}
    known = {each.joint: each for each in reader(bpy.context, rough, space, dragged=True, seen=seen).controls}
    assert known["lhand"] is seen["lhand"]
    assert known["rhand"] is not seen["rhand"]


def test_a_rig_of_ones_own_is_followed_where_it_is_selected(part: Any, rough: bpy.types.Object) -> None:
    other = rough.copy()
    bpy.context.scene.collection.objects.link(other)
    rough.animation_data_clear()
    with pytest.raises(RuntimeError, match="has no action with keys"):
        follow(part, rough)
    other.select_set(True)
    assert bpy.ops.perfanim.follow_rig() == {"FINISHED"}
    controls = part("sketch.controls").controls_of(rough).values()
    assert {each.constraints[0].target for each in controls} == {other}


def test_a_solved_action_is_not_followed(part: Any, rough: bpy.types.Object) -> None:
    follow(part, rough)
    solve(part)
    for each in bpy.context.view_layer.objects:
        each.select_set(False)
    with pytest.raises(RuntimeError, match="is a solved sketch, not a rough action"):
        bpy.ops.perfanim.follow_rig()
