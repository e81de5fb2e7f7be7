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
    found = {
        each.joint: each for each in part("sketch.read_controls").read_controls(bpy.context, keyed, space).controls
    }["lhand"]
    np.testing.assert_array_equal(found.frames, [1, 17])
    np.testing.assert_allclose(space.points_to_scene(found.positions_m)[-1], [1.6, 0.0, 1.0], atol=1e-5)
    for frame in (4.0, 9.0, 14.0):  # between its keys it is led by its parent
        bpy.context.scene.frame_set(int(frame))
        shown = space.points_to_scene(found.curve(np.array([frame])))[0]
        np.testing.assert_allclose(shown, hand.matrix_world.translation, atol=0.01)
    assert np.ptp(space.points_to_scene(found.drawn_m)[:, 0]) == pytest.approx(1.6, abs=1e-4)


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
    assert keyed.perfanim_sketch.free_height
    strays = {}
    for follow in (0.0, 1.0):
        keyed.perfanim_sketch.follow = follow
        assert "all keys are met" in solve(part)
        frames = key_times(curves_of(keyed))
        assert len(frames) == 1 + round(0.75 * np.pi * 30 / 0.8)
        heads = walked(part, keyed, frames[::4])
        along = heads["root"] - np.array(path.location)
        strays[follow] = np.abs(np.hypot(along[:, 0] - 1.5, along[:, 1]) - 1.5)
        assert np.ptp(along[:, 2]) > 0.01  # they rise and sink as a walk's
        # the left thigh is at the left of the way
        left = (heads["lfemur"] - heads["rfemur"])[3:]
        way = np.stack((-along[3:, 1], along[3:, 0] - 1.5), axis=1)
        assert np.all(way[:, 0] * left[:, 1] - way[:, 1] * left[:, 0] > 0.0)
    assert strays[1.0].max() < 0.02
    assert 2.0 * strays[1.0].max() < strays[0.0].max() < 0.3
    assert max(strays[0.0][0], strays[0.0][-1]) < 0.02  # its ends bind


def walked(part: Any, armature: bpy.types.Object, frames: Any) -> dict[str, Any]:
    """Places (F, 3) of hips and thighs in the scene."""
    bones, found = part("character.retarget_plans").bones_of(armature), {"root": [], "lfemur": [], "rfemur": []}
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        for name, places in found.items():
            places.append(armature.matrix_world @ armature.pose.bones[bones[name]].head)
    return {name: np.array(places) for name, places in found.items()}


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
    sketch = part("sketch.read_controls").read_controls(bpy.context, keyed, space)
    keyed.perfanim_sketch.action = bpy.data.actions.new("solved")
    written.keep_sketch(keyed.perfanim_sketch.action, sketch, keyed.perfanim_sketch.solver_settings())
    assert bpy.ops.perfanim.take_up_sketch() == {"FINISHED"}
    again = {
        each.joint: each for each in part("sketch.read_controls").read_controls(bpy.context, keyed, space).controls
    }
    for each in sketch.controls:
        np.testing.assert_array_equal(again[each.joint].frames, each.frames)
        np.testing.assert_allclose(again[each.joint].positions_m, each.positions_m, atol=1e-5)
        np.testing.assert_allclose(again[each.joint].curve(sketch.frames), each.curve(sketch.frames), atol=0.003)
        assert again[each.joint].height_is_free == (each.joint == "root")


def test_a_curve_above_the_floor_leads_hips_also_in_height(part: Any, keyed: bpy.types.Object) -> None:
    path = drawn_path(part, keyed)
    path.data.splines[0].points[5].co.z = 0.4
    part("sketch.controls").controls_of(keyed)["root"].select_set(True)
    assert bpy.ops.perfanim.follow_curve() == {"FINISHED"}
    assert not keyed.perfanim_sketch.free_height
