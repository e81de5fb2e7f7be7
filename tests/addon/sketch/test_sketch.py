"""Sketches in Blender: controls, their keys, the solved action, live edits, and what stays with the file."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.cli.main import main
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.sketch.sketch import Control, Sketch
from perfanim.core.system.assets import MOTION
from played import curves_of, key_times

JOINTS = ("root", "lfoot", "rfoot", "lhand", "rhand")
EVERY = 12
MET = 0.006  # of the scene's metre: a key is met within 5 mm, and keyframes are float32
PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Walking clips without the one that is sketched."""
    clips = [str(path) for path in sorted(MOTION.glob("walking-*.bvh"))[1:5]]
    out = tmp_path_factory.mktemp("database") / "walks.pfdb"
    assert main(["database", "build", *clips, "--fps", "30", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def walk() -> Motion:
    return sliced(resampled(read_motion(sorted(MOTION.glob("walking-*.bvh"))[0]), 30.0), 0, 61)


@pytest.fixture
def keyed(part: Any, database: Path, walk: Motion) -> bpy.types.Object:
    """A character, moved and turned in the scene, with the walk's keys on five controls, from frame 11 on."""
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 30, 1.0
    scene.perfanim.database = str(database)
    name = part("character.create_character").create_character(bpy.context, walk.skeleton)
    armature = bpy.data.objects[name]
    armature.location, armature.rotation_mode = (2.0, -1.0, 0.0), "XYZ"
    armature.rotation_euler = (0.0, 0.0, 0.7)
    bpy.context.view_layer.update()
    scene.perfanim.armature = armature
    key(part, armature, walk)
    return armature


def sketch_of(walk: Motion, first: int = 11) -> Sketch:
    positions = forward_kinematics(walk.skeleton, walk.rotations, walk.root_positions_m)[0]
    at = np.arange(0, walk.frames, EVERY)
    places = {joint: positions[at, walk.skeleton.index(joint)] for joint in JOINTS}
    return Sketch("walk", 30.0, tuple(Control(joint, at + float(first), points) for joint, points in places.items()))


def key(part: Any, armature: bpy.types.Object, walk: Motion) -> None:
    controls, space = part("sketch.controls"), part("sketch.write_solution").SketchBody.of(armature).space
    controls.add_controls(bpy.context, armature, space, JOINTS)
    controls.set_keys(armature, sketch_of(walk), space)


def solve(part: Any, operator: str = "PERFANIM_OT_solve_sketch") -> str:
    found = getattr(part("operators.sketch"), operator)
    clicked = SimpleNamespace()
    clicked.bounds = lambda context: found.bounds(clicked, context)
    return run_job(part, found, clicked)


def distances(part: Any, armature: bpy.types.Object, frames: Any) -> dict[str, list[float]]:
    """Distance of each control from its bone, in the scene."""
    bones = part("character.posing").bones_of(armature)
    found: dict[str, list[float]] = {}
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        graph = bpy.context.evaluated_depsgraph_get()
        posed = armature.evaluated_get(graph)
        for joint, control in part("sketch.controls").controls_of(armature).items():
            head = posed.matrix_world @ posed.pose.bones[bones[joint]].head
            away = (head - control.evaluated_get(graph).matrix_world.translation).length
            found.setdefault(joint, []).append(away)
    return found


def test_controls_stand_at_the_present_pose(part: Any, keyed: bpy.types.Object) -> None:
    controls = part("sketch.controls")
    for control in controls.controls_of(keyed).values():
        bpy.data.objects.remove(control)
    keyed.pose.bones["lhumerus"].rotation_quaternion = (0.8, 0.0, 0.6, 0.0)
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
    found = part("sketch.controls").read_controls(bpy.context, keyed, space)
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


def test_what_cannot_be_a_sketch_is_refused(part: Any, keyed: bpy.types.Object, extension: str) -> None:
    errors = sys.modules[f"{extension}.core.errors"]
    controls = part("sketch.controls")
    space = part("sketch.write_solution").SketchBody.of(keyed).space
    root = controls.controls_of(keyed)["root"]
    root.location.x = 5000.0
    root.keyframe_insert("location", frame=20)
    with pytest.raises(errors.SettingsError, match="m away"):
        controls.read_controls(bpy.context, keyed, space)
    root.animation_data_clear()
    root.location.x = 0.0
    for frame in (0, 30000):
        root.keyframe_insert("location", frame=frame)
    with pytest.raises(errors.SettingsError, match="at most"):
        controls.read_controls(bpy.context, keyed, space)
    for each in controls.controls_of(keyed).values():
        each.animation_data_clear()
    with pytest.raises(errors.SettingsError, match="no control has a key"):
        controls.read_controls(bpy.context, keyed, space)


def test_unknown_behaviours_are_told(part: Any, keyed: bpy.types.Object, extension: str) -> None:
    keyed.perfanim_sketch.behaviours = "swimming"
    with pytest.raises(sys.modules[f"{extension}.core.errors"].PerfanimError, match="swimming"):
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
    assert {"lhumerus", "lhand"} <= groups
    assert not {"rhumerus", "ltibia", "root"} & groups


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


def test_a_rough_animation_becomes_keys_of_controls(part: Any, keyed: bpy.types.Object) -> None:
    for control in part("sketch.controls").controls_of(keyed).values():
        bpy.data.objects.remove(control)
    bone = keyed.pose.bones["lhumerus"]
    for frame, turn in ((1, 0.0), (20, 0.9), (31, 0.2)):
        bone.rotation_quaternion = (np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2))
        bone.keyframe_insert("rotation_quaternion", frame=frame)
    assert bpy.ops.perfanim.add_controls(from_action=True) == {"FINISHED"}
    for control in part("sketch.controls").controls_of(keyed).values():
        np.testing.assert_array_equal(key_times(curves_of(control)), [1, 20, 31])
    off = distances(part, keyed, [1, 20, 31])
    assert max(max(each) for each in off.values()) < 1e-4


def play(part: Any) -> None:
    """Be Blender's timer until all edits are solved."""
    live = part("sketch.live_sketch").current()
    limit_s = time.monotonic() + PATIENCE_S
    live.tick(bpy.context)
    while not live.idle:
        live.tick(bpy.context)
        assert time.monotonic() < limit_s
        time.sleep(0.002)


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


def drawn_path(part: Any, armature: bpy.types.Object) -> bpy.types.Object:
    """An arc that the mouse would draw: a metre and a half ahead and to the left."""
    assert bpy.ops.perfanim.draw_hips_path() == {"FINISHED"}
    path = bpy.context.view_layer.objects.active
    assert (path.type, path.mode) == ("CURVE", "EDIT")
    bpy.ops.object.mode_set(mode="OBJECT")
    spline = path.data.splines.new("POLY")
    spline.points.add(30)
    for point, angle in zip(spline.points, np.linspace(0.0, np.pi / 2.0, 31), strict=True):
        point.co = (1.5 - 1.5 * np.cos(angle), -1.5 * np.sin(angle), 0.0, 1.0)
    return path


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
    whole = controls.read_controls(bpy.context, keyed, space)
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
            wanted = controls.read_controls(bpy.context, keyed, space) if step_m else whole
            for one, other in zip(stored.controls, wanted.controls, strict=True):
                np.testing.assert_array_equal(one.frames, other.frames)
                np.testing.assert_allclose(one.positions_m, other.positions_m, atol=0.003)
        assert scene.frame_current == 11
    finally:
        live.end()


def test_a_path_without_a_length_is_refused(part: Any, keyed: bpy.types.Object) -> None:
    assert bpy.ops.perfanim.draw_hips_path() == {"FINISHED"}
    with pytest.raises(RuntimeError, match="has no length; draw it"):
        bpy.ops.perfanim.follow_curve()


def test_sides_have_colours_of_their_own(part: Any) -> None:
    colour_of = part("sketch.control_colours").colour_of
    assert colour_of("lhand") == colour_of("ltoes") != colour_of("rhand") == colour_of("rfoot")
    middle = colour_of("root")
    assert middle == colour_of("lowerback") == colour_of("head")
    assert middle not in (colour_of("lhand"), colour_of("rhand"))
