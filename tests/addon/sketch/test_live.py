"""A sketch that is solved again at each edit."""

import time
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Vector
from perfanim.core.body.motion import Motion
from played import curves_of, key_times
from sketched import MET, PATIENCE_S, distances, drawn_hand, drawn_path, play, played_live, sketch_of, solve

pytestmark = pytest.mark.usefixtures("near_worker")  # but live has a process


def test_the_body_follows_edits(part: Any, keyed: bpy.types.Object, walk: Motion) -> None:
    solve(part)
    with played_live(part) as live:
        play(part)
        scene, hand = bpy.context.scene, part("sketch.controls").controls_of(keyed)["rhand"]
        scene.frame_set(35)
        hand.location.z += 0.05  # dragged, not keyed yet
        bpy.context.view_layer.update()
        assert live.current().noted
        play(part)
        bpy.context.view_layer.update()  # as a redraw does
        bones = part("character.retarget_plans").bones_of(keyed)
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
    assert live._note not in bpy.app.handlers.depsgraph_update_post
    assert live.current() is None


@pytest.mark.long
def test_live_follows_edits_of_a_path_and_keeps_what_only_other_frames_tell(part: Any, keyed: bpy.types.Object) -> None:
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
    with played_live(part) as live:
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


def test_a_handle_is_an_edit(part: Any, keyed: bpy.types.Object) -> None:
    hand = drawn_hand(part, keyed)
    with played_live(part) as live:
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


@pytest.fixture
def live(part: Any, keyed: bpy.types.Object) -> Any:
    """Live, played by the test."""
    with ExitStack() as stack:

        def begin() -> Any:
            bpy.context.scene.frame_set(11)  # controls stand where their curves have them
            return stack.enter_context(played_live(part)).current()

        yield begin


def test_the_first_motion_is_written_in_pieces(
    part: Any, keyed: bpy.types.Object, walk: Motion, live: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = part("sketch.live_sketch")
    monkeypatch.setattr(module, "EDITING", replace(module.EDITING, slice_s=1e-4))
    bpy.context.scene.perfanim_result.reduce = True
    begun, most = live(), []
    limit_s = time.monotonic() + PATIENCE_S
    while not begun.idle:
        begun.tick(bpy.context)
        action = keyed.perfanim_sketch.action
        most.append(0 if action is None else sum(len(curve.keyframe_points) for curve in curves_of(keyed)))
        assert time.monotonic() < limit_s
    steps = np.diff([count for count in most if count])
    assert len(steps[steps > 0]) > 4
    np.testing.assert_array_equal(key_times(curves_of(keyed)), sketch_of(walk).frames)
    off = distances(part, keyed, [11, 23, 35, 47])
    assert max(max(each) for each in off.values()) < MET


def test_a_baked_action_is_kept_and_the_panel_tells(part: Any, keyed: bpy.types.Object, live: Any) -> None:
    solve(part, "PERFANIM_OT_bake_sketch")
    baked = keyed.animation_data.action
    count = sum(len(curve.keyframe_points) for curve in curves_of(keyed))
    live()
    play(part)
    assert keyed.animation_data.action == keyed.perfanim_sketch.action != baked
    assert f"{baked.name} is kept" in part("jobs.activity").message("sketch")[0]
    keyed.animation_data.action = baked
    assert sum(len(curve.keyframe_points) for curve in curves_of(keyed)) == count


def test_ending_live_leaves_no_half_filled_action(part: Any, keyed: bpy.types.Object, walk: Motion, live: Any) -> None:
    begun, limit_s = live(), time.monotonic() + PATIENCE_S
    while keyed.perfanim_sketch.action is None:
        begun.tick(bpy.context)
        assert time.monotonic() < limit_s
    assert not begun.idle
    assert bpy.ops.perfanim.live_sketch() == {"FINISHED"}
    np.testing.assert_array_equal(key_times(curves_of(keyed)), sketch_of(walk).frames)


@pytest.mark.parametrize("onto", ["STRIP", "LAYER"])
def test_a_strip_follows_edits(part: Any, keyed: bpy.types.Object, walk: Motion, live: Any, onto: str) -> None:
    bpy.context.scene.perfanim_result.onto = onto
    begun = live()
    play(part)
    hand, last = part("sketch.controls").controls_of(keyed)["rhand"], sketch_of(walk).frames[-1]
    hand.keyframe_insert("location", frame=last + 8)
    begun.noted = True
    play(part)
    (strip,) = (each for track in keyed.animation_data.nla_tracks for each in track.strips)
    assert strip.action == keyed.perfanim_sketch.action
    assert (strip.frame_start, strip.frame_end) == (11, last + 8)
    off = distances(part, keyed, [23, 35, 47])  # a layer blends in and out
    assert max(max(each) for each in off.values()) < MET


def test_an_action_that_is_deleted_while_it_is_filled_is_made_again(
    part: Any, keyed: bpy.types.Object, walk: Motion, live: Any
) -> None:
    begun, limit_s = live(), time.monotonic() + PATIENCE_S
    while keyed.perfanim_sketch.action is None:
        begun.tick(bpy.context)
        assert time.monotonic() < limit_s
    bpy.data.actions.remove(keyed.perfanim_sketch.action)
    keyed.animation_data_clear()
    keyed.perfanim_sketch.follow = 0.9
    begun.noted = True
    play(part)
    np.testing.assert_array_equal(key_times(curves_of(keyed)), sketch_of(walk).frames)
