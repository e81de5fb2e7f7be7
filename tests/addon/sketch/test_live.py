"""A sketch that is solved again at each edit."""

from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Vector
from perfanim.core.body.motion import Motion
from played import curves_of, key_times
from sketched import MET, distances, drawn_hand, drawn_path, play, sketch_of, solve


def test_the_body_follows_edits(part: Any, keyed: bpy.types.Object, walk: Motion) -> None:
    solve(part)
    assert bpy.ops.perfanim.live_sketch() == {"FINISHED"}
    live = part("sketch.live_sketch")
    bpy.app.timers.unregister(live._tick)  # the test plays it
    try:
        play(part)
        scene, hand = bpy.context.scene, part("sketch.controls").controls_of(keyed)["rhand"]
        scene.frame_set(35)
        hand.location.z += 0.05  # dragged, not keyed yet
        bpy.context.view_layer.update()
        assert live.current().noted
        play(part)
        bpy.context.view_layer.update()  # as a redraw does
        bones = part("character.posing").bones_of(keyed)
        shown = keyed.matrix_world @ keyed.pose.bones[bones["rhand"]].head
        assert (shown - hand.location).length < MET
        hand.keyframe_insert("location", frame=35)
        bpy.context.view_layer.update()
        play(part)
        off = distances(part, keyed, [11, 23, 35, 47])
        assert max(max(each) for each in off.values()) < MET
        last = sketch_of(walk).frames[-1]
        hand.keyframe_insert("location", frame=last + 8)  # the motion grows
        bpy.context.view_layer.update()
        live.current().noted = True
        play(part)
        assert key_times(curves_of(keyed))[-1] == last + 8
        stored, _ = part("sketch.write_solution").kept_sketch(keyed.animation_data.action)
        assert stored.frames[-1] == last + 8
    finally:
        live.end()
    assert live._note not in bpy.app.handlers.depsgraph_update_post
    assert live.current() is None


def test_live_follows_edits_of_a_path_and_keeps_what_only_other_frames_tell(part: Any, keyed: bpy.types.Object) -> None:
    solve(part)
    controls, scene = part("sketch.controls"), bpy.context.scene
    found = controls.controls_of(keyed)
    for joint in ("lfoot", "rfoot", "rhand"):
        bpy.data.objects.remove(found[joint])
    hand, hips = found["lhand"], found["root"]
    hand.parent = keyed  # where this leads is known only where the scene is shown
    scene.frame_set(11)
    path = drawn_path(part, keyed)
    hips.select_set(True)
    assert bpy.ops.perfanim.follow_curve() == {"FINISHED"}
    space = part("sketch.write_solution").SketchBody.of(keyed).space
    whole = part("sketch.read_controls").read_controls(bpy.context, keyed, space)
    assert bpy.ops.perfanim.live_sketch() == {"FINISHED"}
    live = part("sketch.live_sketch")
    bpy.app.timers.unregister(live._tick)  # the test plays it
    try:
        for step_m in (0.0, 0.3):
            for point in path.data.splines[0].points[15:]:
                point.co.z += step_m
            path.data.update_tag()
            bpy.context.view_layer.update()
            assert live.current().noted or step_m == 0.0
            play(part)
            bpy.context.view_layer.update()
            stored, _ = part("sketch.write_solution").kept_sketch(keyed.perfanim_sketch.action)
            wanted = part("sketch.read_controls").read_controls(bpy.context, keyed, space) if step_m else whole
            for one, other in zip(stored.controls, wanted.controls, strict=True):
                np.testing.assert_array_equal(one.frames, other.frames)
                np.testing.assert_allclose(one.positions_m, other.positions_m, atol=0.003)
        assert scene.frame_current == 11
    finally:
        live.end()


def test_a_handle_is_an_edit(part: Any, keyed: bpy.types.Object) -> None:
    hand = drawn_hand(part, keyed)
    solve(part)
    assert bpy.ops.perfanim.live_sketch() == {"FINISHED"}
    live = part("sketch.live_sketch")
    bpy.app.timers.unregister(live._tick)  # the test plays it
    try:
        play(part)
        key = curves_of(hand)[2].keyframe_points[1]
        key.handle_left_type = key.handle_right_type = "FREE"
        key.handle_right.y += 0.3
        hand.animation_data.action.update_tag()  # as Blender's editors do
        bpy.context.view_layer.update()
        assert live.current().noted
        play(part)
        stored, _ = part("sketch.write_solution").kept_sketch(keyed.perfanim_sketch.action)
        control = next(each for each in stored.controls if each.joint == "lhand")
        place = keyed.matrix_world.inverted() @ Vector([curve.evaluate(14) for curve in curves_of(hand)])
        assert control.curve(np.array([14.0]))[0, 1] == pytest.approx(place.z, abs=1e-4)
    finally:
        live.end()
