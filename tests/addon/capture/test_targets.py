"""Further targets: objects that follow props, live and from takes, in the hand of the character."""

from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from mathutils import Matrix, Quaternion, Vector
from perfanim.core.body.scene_pose import PropPose
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.markers.marker_take import MarkerTake, save_take
from perfanim.core.markers.prop import load_prop, save_prop
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.system.assets import MOTION
from played import curves_of, key_times
from props import held_poses
from ticking import stop_and_keep, tick_poses

POSES = 30
# what test_prop_tracking allows, seen from farther off: 0.1 pixel is less than the simulated cameras' noise makes
PLACE_M, TURN_DEG = 0.01, 3.0


def test_the_list_says_what_is_wrong(part: Any, targets: Any, tmp_path: Path) -> None:
    module, scene = part("settings.target_settings"), bpy.context.scene
    assert module.problem(scene) == ""
    first = targets.entries.add()
    assert module.title(first) == "sword"
    assert module.problem(scene) == ""
    second = targets.entries.add()
    assert "two props have the same name" in module.problem(scene)
    second.definition = str(tmp_path / "gone.toml")
    assert "gone.toml" in module.problem(scene)
    second.definition = str(tmp_path / "line.toml")
    (tmp_path / "line.toml").write_text(
        'kind = "perfanim prop"\nversion = 1\nname = "stick"\n'
        + "".join(f'[[marker]]\nname = "{i}"\nposition_m = [0, {0.1 * i**2}, 0]\n' for i in range(3))
    )
    assert "on a line" in module.problem(scene)
    targets.entries.remove(1)
    parent, child = (bpy.data.objects.new(name, None) for name in ("Parent", "Child"))
    child.parent = parent
    first.object = child
    assert "Child: is moved by its parent" in module.problem(scene)


def test_buttons_add_and_remove(part: Any, targets: Any) -> None:
    running = part("jobs.activity")
    assert not bpy.ops.perfanim.remove_target.poll()
    assert not bpy.ops.perfanim.measure_target.poll()
    assert running.current() is None
    for _ in range(2):
        bpy.ops.perfanim.add_target()
    assert (len(targets.entries), targets.active) == (2, 1)
    bpy.ops.perfanim.remove_target()
    assert (len(targets.entries), targets.active) == (1, 0)


@pytest.mark.usefixtures("near_worker")
def test_a_prop_is_measured_from_the_chosen_take(part: Any, targets: Any, tmp_path: Path) -> None:
    """Lying still before the cameras: what another system's take, or a capture, shows of it."""
    sword, generator = load_prop("sword"), np.random.default_rng(0)
    still = sword.positions_m + np.array([0.0, 1.0, 0.0]) + generator.normal(scale=0.001, size=(30, 5, 3))
    save_take(MarkerTake("still", 60.0, sword.names, still), tmp_path / "still.take.npz")
    bpy.ops.perfanim.add_target()
    listed = bpy.context.window_manager.perfanim_takes
    listed.entries.add().path = str(tmp_path / "still.take.npz")
    operator = part("operators.target_operators").PERFANIM_OT_measure_target
    assert bpy.ops.perfanim.measure_target.poll() == (bpy.context.window is not None)
    played = SimpleNamespace(called="My Sword")
    told = run_job(part, operator, played)
    listed.entries.clear()
    assert told.startswith("My Sword: 5 markers, rigid to ")
    assert part("settings.target_settings").title(targets.entries[0]) == "My Sword"
    assert part("settings.target_settings").problem(bpy.context.scene) == ""


def expected_matrix(part: Any, armature: Any, turn: np.ndarray, place: np.ndarray) -> Matrix:
    """Where a prop of the performer's room stands beside a character of the performer's own size."""
    axes = Matrix(part("character.axes").BLENDER_FROM_WORLD)
    turned = axes @ Quaternion(turn).to_matrix() @ axes.inverted()
    return armature.matrix_world @ Matrix.Translation(axes @ Vector(place)) @ turned.to_4x4()


def check_placed(target: Any, wanted: Matrix) -> None:
    bpy.context.view_layer.update()
    assert (target.matrix_world.translation - wanted.translation).length < PLACE_M
    turned = target.matrix_world.to_quaternion().rotation_difference(wanted.to_quaternion()).angle
    assert np.degrees(min(turned, 2 * np.pi - turned)) < TURN_DEG


@pytest.mark.long
def test_a_sword_is_in_the_characters_hand_live_and_in_the_action(
    part: Any, chosen: Any, targets: Any, new_capture: Any, tmp_path: Path
) -> None:
    scene = bpy.context.scene
    build_database([str(MOTION / "kendo-01-proud.bvh")], tmp_path / "kendo.pfdb", BuildSettings(fps=30.0))
    chosen.database = str(tmp_path / "kendo.pfdb")
    scene.render.fps, scene.frame_current = 60, 5
    chosen.behaviour = "kendo"
    targets.entries.add()
    source = open_simulated({"behaviour": "kendo", "height_m": 1.75, "at_once": True, "seconds": 60.0, "prop": "sword"})
    turns, places = held_poses(load_prop("sword"), source.motion)
    with closing(new_capture()) as capture:
        tick_poses(capture, POSES)
        character, sword = chosen.armature, targets.entries[0].object
        assert sword.name == "sword"
        newest = capture.run.poses[-1]
        check_placed(sword, expected_matrix(part, character, turns[newest.number], places[newest.number]))
        text = stop_and_keep(capture)
    poses = capture.run.poses
    found = [pose for pose in poses if pose.props[0].found]
    assert len(found) >= POSES - 10  # a few frames until it is sure
    assert "Capture sword" in text
    action = sword.animation_data.action
    assert action.name == "Capture sword"
    times = key_times(curves_of(sword))
    np.testing.assert_allclose(times, [5 + 60 * (pose.time_s - poses[0].time_s) for pose in found], atol=1e-3)
    middle = found[len(found) // 2]
    scene.frame_set(round(5 + 60 * (middle.time_s - poses[0].time_s)))
    check_placed(sword, expected_matrix(part, character, turns[middle.number], places[middle.number]))
    # the take has it too, and is put on another object, of a character that stands elsewhere and is twice as large
    take = read_take_file(part("take_library").listed()[0].path)
    assert [solved.pose.props[0].seen for solved in take.poses] == [pose.props[0].seen for pose in poses]
    character.location, character.scale = (3.0, 1.0, 0.0), (2.0, 2.0, 2.0)
    cube = bpy.data.objects.new("Cube", None)
    scene.collection.objects.link(cube)
    save_prop(load_prop("sword"), tmp_path / "same.toml")
    targets.entries[0].definition, targets.entries[0].object = str(tmp_path / "same.toml"), cube
    scene.frame_set(5)
    bpy.ops.perfanim.play_take(path=str(take.path))
    scene.frame_set(round(5 + 60 * (middle.time_s - poses[0].time_s)))
    bpy.context.view_layer.update()
    wanted = expected_matrix(part, character, turns[middle.number], places[middle.number])
    assert (cube.matrix_world.translation - wanted.translation).length < 2 * PLACE_M
    assert tuple(cube.scale) == (1.0, 1.0, 1.0)


@pytest.mark.long
def test_a_second_performer_and_a_sword_are_found_from_the_start(
    part: Any, chosen: Any, targets: Any, new_capture: Any, tmp_path: Path
) -> None:
    """Beside a second performer, the sword in a hand of a T pose would reach out of the picture."""
    clips = [str(path) for name in ("boxing", "walking") for path in MOTION.glob(f"{name}-0[12]-*.bvh")]
    build_database(clips, tmp_path / "two.pfdb", BuildSettings(fps=10.0))
    chosen.database, chosen.behaviour = str(tmp_path / "two.pfdb"), "demo"
    targets.entries.add()
    targets.entries.add().kind = "PERFORMER"
    with closing(new_capture()) as capture:
        tick_poses(capture, POSES)
        text = stop_and_keep(capture)
    poses = capture.run.poses
    assert sum(pose.props[0].found for pose in poses) >= 0.9 * len(poses)
    assert all(np.sum(body.seen) >= 7 for pose in poses for body in pose.performers)  # of nine markers
    assert "in Capture, Capture sword, Capture Performer 2: " in text
    assert "never found" not in text


def test_an_objects_own_action_is_given_back_when_nothing_is_kept(
    part: Any, targets: Any, skeleton: Any, armature: Any
) -> None:
    targets.entries.add().object = cube = bpy.data.objects.new("Cube", None)
    cube.animation_data_create().action = old = bpy.data.actions.new("Old")
    room = part("capture.capture_space").CaptureSpace(
        armature, part("character.retarget_plans").plan_for(armature, skeleton)
    )
    held = part("capture.scene_driver").SuspendedActions()
    following = part("capture.scene_driver").PropDriver([load_prop("sword")], held)

    def follow(place_m: tuple[float, ...], *seen: Any) -> None:
        following.apply(bpy.context, [PropPose(np.array([1.0, 0, 0, 0]), np.array(place_m), *seen)], room)

    follow((0.0, 0.0, 0.0))
    assert cube.animation_data.action is old  # not seen yet: it is left alone
    follow((0.0, 1.0, 0.5), 0.001, 5)
    assert cube.animation_data.action is None
    assert (cube.location - armature.location - Vector((0.0, -0.5, 1.0))).length < 1e-5
    held.give_back()
    assert cube.animation_data.action is old
    bpy.data.objects.remove(cube)
    follow((0.0, 0.0, 0.0), 0.001, 5)  # deleted meanwhile: no error
