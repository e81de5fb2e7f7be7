"""The curve that the animator has drawn between the keys of a control."""

from typing import Any

import bpy
import numpy as np
import pytest
from perfanim.core.sketch.sketch_file import Control
from played import curves_of
from sketched import drawn_hand


def read(part: Any, armature: bpy.types.Object, joint: str = "lhand") -> tuple[Control, Any]:
    space = part("sketch.write_solution").SketchBody.of(armature).space
    found = part("sketch.read_controls").read_controls(bpy.context, armature, space)
    control = next(each for each in found.controls if each.joint == joint)
    at = control.frames[0] + np.arange(1.0 + control.frames[-1] - control.frames[0])
    return control, space.points_to_scene(control.curve(at))


def shown(control: bpy.types.Object, frames: Any) -> Any:
    """Places (F, 3) where Blender shows a control."""
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        found.append(np.array(control.matrix_world.translation))
    return np.array(found)


def test_default_curves_of_a_turned_character_are_read_as_blender_shows_them(
    part: Any, keyed: bpy.types.Object
) -> None:
    hand = drawn_hand(part, keyed)
    control, curve = read(part, keyed)
    assert control.frames.tolist() == [1.0, 11.0, 31.0]
    np.testing.assert_allclose(curve, shown(hand, range(1, 32)), atol=1e-4)


@pytest.mark.parametrize("interpolation", ["LINEAR", "CONSTANT", "BOUNCE", "SINE"])
def test_interpolation_is_read_as_blender_shows_it(part: Any, keyed: bpy.types.Object, interpolation: str) -> None:
    hand = drawn_hand(part, keyed)
    for key in (key for curve in curves_of(hand) for key in curve.keyframe_points):
        key.interpolation = interpolation
    control, curve = read(part, keyed)
    assert control.frames.tolist() == [1.0, 11.0, 31.0]
    np.testing.assert_allclose(curve, shown(hand, range(1, 32)), atol=1e-4)


def test_handles_are_read_as_blender_shows_them(part: Any, keyed: bpy.types.Object) -> None:
    hand = drawn_hand(part, keyed)
    before = read(part, keyed)[1]
    key = curves_of(hand)[2].keyframe_points[1]
    key.handle_left_type = key.handle_right_type = "FREE"
    key.handle_right.y += 0.6
    control, curve = read(part, keyed)
    assert control.frames.tolist() == [1.0, 11.0, 31.0]
    np.testing.assert_allclose(curve, shown(hand, range(1, 32)), atol=1e-4)
    assert np.abs(curve - before).max() > 0.1


def test_breakdowns_lead_the_curve_and_do_not_bind(part: Any, keyed: bpy.types.Object) -> None:
    hand = drawn_hand(part, keyed)
    for key in (curve.keyframe_points[1] for curve in curves_of(hand)):
        key.type = "BREAKDOWN"
    control, curve = read(part, keyed)
    assert control.frames.tolist() == [1.0, 31.0]
    np.testing.assert_allclose(curve, shown(hand, range(1, 32)), atol=1e-4)


def test_keys_of_single_channels_keep_the_other_channels_curves(part: Any, keyed: bpy.types.Object) -> None:
    hand = drawn_hand(part, keyed)
    for curve in curves_of(hand)[:2]:
        curve.keyframe_points.remove(curve.keyframe_points[1])
    control, curve = read(part, keyed)
    assert control.frames.tolist() == [1.0, 11.0, 31.0]
    np.testing.assert_allclose(curve, shown(hand, range(1, 32)), atol=1e-4)
