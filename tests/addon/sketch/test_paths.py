"""Controls on paths, with parents or constraints: they suggest a way."""

from typing import Any

import bpy
import numpy as np
import pytest
from played import curves_of, key_times
from sketched import drawn_path, solve


def test_a_hand_on_a_path_is_read_where_it_is_shown(part: Any, keyed: bpy.types.Object) -> None:
    controls = part("sketch.controls")
    space = part("sketch.write_solution").SketchBody.of(keyed).space
    carrier = bpy.data.objects.new("carrier", None)
    bpy.context.scene.collection.objects.link(carrier)
    for frame, x in ((1, 0.0), (17, 1.6)):
        carrier.location.x = x
        carrier.keyframe_insert("location", frame=frame)
    hand = controls.controls_of(keyed)["lhand"]
    hand.animation_data_clear()
    hand.location = (0.0, 0.0, 1.0)
    hand.parent = carrier
    for frame in (1, 17):
        hand.keyframe_insert("location", frame=frame)
    found = {each.joint: each for each in controls.read_controls(bpy.context, keyed, space).controls}["lhand"]
    np.testing.assert_array_equal(found.frames, [1, 9, 17])
    np.testing.assert_allclose(space.points_to_scene(found.positions_m)[-1], [1.6, 0.0, 1.0], atol=1e-5)


def test_hips_follow_a_drawn_path_and_the_body_goes_along_it(part: Any, keyed: bpy.types.Object) -> None:
    controls = part("sketch.controls")
    for joint, control in controls.controls_of(keyed).items():
        if joint != "root":
            bpy.data.objects.remove(control)
    hips = controls.controls_of(keyed)["root"]
    bpy.context.scene.frame_set(11)
    height = hips.matrix_world.translation.z
    with pytest.raises(RuntimeError, match="Select a curve"):
        bpy.ops.perfanim.follow_curve()
    path = drawn_path(part, keyed)
    assert bpy.ops.perfanim.follow_curve() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert hips.matrix_world.translation.z == pytest.approx(height, abs=1e-4)
    assert "all keys are met" in solve(part)
    frames = key_times(curves_of(keyed))
    assert len(frames) == 1 + round(0.75 * np.pi * 30 / 0.8)
    bones = part("character.posing").bones_of(keyed)
    for frame in frames[::8]:
        bpy.context.scene.frame_set(int(frame))
        at = keyed.matrix_world @ keyed.pose.bones[bones["root"]].head - path.location
        assert np.hypot(at.x - 1.5, at.y) == pytest.approx(1.5, abs=0.02)
        assert at.z == pytest.approx(height - path.location.z, abs=0.01)
        if frame > frames[0] + 8:  # the left thigh is at the left of the way
            heads = [keyed.matrix_world @ keyed.pose.bones[bones[name]].head for name in ("lfemur", "rfemur")]
            left = heads[0] - heads[1]
            way = np.array([-at.y, at.x - 1.5])
            assert way[0] * left.y - way[1] * left.x > 0.0


def test_a_path_without_a_length_is_refused(part: Any, keyed: bpy.types.Object) -> None:
    assert bpy.ops.perfanim.draw_hips_path() == {"FINISHED"}
    with pytest.raises(RuntimeError, match="has no length; draw it"):
        bpy.ops.perfanim.follow_curve()


def test_a_sketch_along_a_path_is_taken_up_where_it_was(part: Any, keyed: bpy.types.Object) -> None:
    controls, written = part("sketch.controls"), part("sketch.write_solution")
    bpy.context.scene.frame_set(11)
    path = drawn_path(part, keyed)
    path.location.x += 2.0
    hips, hand = (controls.controls_of(keyed)[joint] for joint in ("root", "lhand"))
    hips.select_set(True)
    assert bpy.ops.perfanim.follow_curve() == {"FINISHED"}
    hand.parent = keyed
    space = written.SketchBody.of(keyed).space
    sketch = controls.read_controls(bpy.context, keyed, space)
    keyed.perfanim_sketch.action = bpy.data.actions.new("solved")
    written.keep_sketch(keyed.perfanim_sketch.action, sketch, keyed.perfanim_sketch.solver_settings())
    assert bpy.ops.perfanim.take_up_sketch() == {"FINISHED"}
    again = {each.joint: each for each in controls.read_controls(bpy.context, keyed, space).controls}
    for each in sketch.controls:
        np.testing.assert_array_equal(again[each.joint].frames, each.frames)
        np.testing.assert_allclose(again[each.joint].positions_m, each.positions_m, atol=1e-5)
