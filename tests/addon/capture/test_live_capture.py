"""A capture in Blender without a window: the real worker, session, armature and action; the test plays the timer."""

from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import cv2
import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.core.session.pose_filters import FilterSettings, filter_poses
from perfanim.core.simulate.studio.simulated_source import open_simulated
from played import curves_of, key_times
from solved_poses import scene_pose
from ticking import stop_and_keep, tick, tick_poses, tick_until


@pytest.mark.usefixtures("as_recorded")
def test_the_defaults_capture_a_new_character_into_one_action(part: Any, chosen: Any, new_capture: Any) -> None:
    bpy.context.scene.render.fps = 24
    bpy.context.scene.frame_current = 11
    with closing(new_capture(is_first=True)) as capture:
        tick_poses(capture, 30)
        character = chosen.armature
        assert character.type == "ARMATURE"
        bone = character.pose.bones["thigh.L"]
        assert not np.allclose(bone.rotation_quaternion, (1, 0, 0, 0))
        before = np.array(bone.rotation_quaternion)
        for frame in (40, 3, 90):  # the timeline is free to be played
            bpy.context.scene.frame_set(frame)
            np.testing.assert_array_equal(bone.rotation_quaternion, before)
        overlay = part("viewport.overlay")
        assert overlay._state.parts == {"MARKERS", "GHOST"}
        chosen.overlay = set()
        tick_until(capture, lambda: not overlay.handler.added)
        chosen.overlay = {"SKELETON"}
        tick_poses(capture, len(capture.run.poses) + 6)
        check_drawn_over(character, overlay._state)
        overlay.hide()
        text = stop_and_keep(capture)
        assert capture._refinement is None  # a simulated performer's body is known
    figures, poses = capture.run.statistics, capture.run.poses
    assert figures.handed_over == figures.received == len(poses) >= 36
    assert f"{len(poses)} frames recorded" in text
    take = read_take_file(part("take_library").listed()[0].path)
    assert take.complete
    assert len(take.frames) == len(take.poses) == len(poses)
    # the take keeps the poses as they were solved, the character's feet are held
    held = filter_poses([kept.pose for kept in take.poses], take.setup.subjects(), 0.0, FilterSettings(feet="auto"))
    for pose, shown in zip(held, poses, strict=True):
        np.testing.assert_array_equal(pose.performers[0].rotations, shown.performers[0].rotations)
    assert len(bpy.data.actions) == 1
    times = key_times(curves_of(character))
    seconds = np.array([pose.time_s for pose in poses])
    np.testing.assert_allclose(times, 11 + 24 * (seconds - seconds[0]), atol=1e-3)
    assert bpy.context.scene.frame_end >= times[-1]
    for curve in curves_of(character):
        assert curve.data_path.endswith(("rotation_quaternion", "location"))
        assert len(curve.keyframe_points) == len(poses)


def check_drawn_over(character: Any, drawn: Any) -> None:
    """The skeleton lies on the bones of a character of the performer's own proportions."""
    (pose,), skeleton = drawn.pose.performers, drawn.scene.performers[0][0]
    places = drawn.scene.placed(forward_kinematics(skeleton, pose.rotations, pose.root_position_m)[0])
    bpy.context.view_layer.update()
    heads = [character.matrix_world @ character.pose.bones[NAMINGS["blender"][name]].head for name in skeleton.names]
    np.testing.assert_allclose(places, np.array(heads), atol=1e-4)


def test_stop_before_the_first_frame_leaves_the_old_action(armature: Any, new_capture: Any) -> None:
    armature.animation_data_create().action = old = bpy.data.actions.new("Old")
    with closing(new_capture()) as capture:
        tick_until(capture, lambda: capture.run is not None)
        assert armature.animation_data.action is None  # so that it does not pull at the bones
        capture.stop()
        tick_until(capture, lambda: capture.done)
        capture.run.poses = []  # a fast machine may have sent some before the stop
        assert capture.keep(bpy.context) == ""
    assert armature.animation_data.action is old


def quaternion_at(armature: Any, bone: str, frame: int) -> np.ndarray:
    bpy.context.scene.frame_set(frame)
    return np.array(armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones[bone].rotation_quaternion)


def swing(skeleton: Any, bones: tuple[str, ...], frames: int) -> np.ndarray:
    """Rotations (F, J, 4) of bones that turn steadily about x."""
    result = np.zeros((frames, len(skeleton), 4))
    result[..., 0] = 1.0
    half = 0.004 * np.arange(1.0, frames + 1.0)
    for bone in bones:
        result[:, skeleton.index(bone)] = np.stack((np.cos(half), np.sin(half), 0 * half, 0 * half), axis=1)
    return result


def anna(skeleton: Any, rotations: np.ndarray) -> tuple[list[Any], Subject]:
    """Poses of Anna with rotations (F, J, 4), 60 a second and numbered from 5 on, and Anna."""
    poses = [scene_pose(5 + n, turned, (0.0, 1.0, 0.0), 1.0) for n, turned in enumerate(rotations)]
    return poses, Subject("Anna", skeleton, load_marker_set("boxing"))


def test_a_recording_of_a_length_says_which_part_of_the_take_it_is(chosen: Any, play: Any, skeleton: Any) -> None:
    bpy.context.scene.render.fps = 60
    bpy.context.scene.frame_set(7)
    chosen.record_length_s = 0.5
    capture = play(*anna(skeleton, swing(skeleton, ("head",), 60)))
    tick(capture, 45)
    assert capture.recording is None
    assert capture.keep(bpy.context).startswith("31 frames recorded")
    assert len(capture.run.poses) == 44
    ((take, _, span),) = play.marked
    assert (take, span) == ("a.perftake", (5, 35))
    times = key_times(curves_of(chosen.armature))
    np.testing.assert_allclose(times, np.arange(7.0, 38.0), atol=1e-3)


def test_a_rehearsal_records_what_the_button_says(
    part: Any, chosen: Any, play: Any, skeleton: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bpy.context.scene.render.fps = 60
    chosen.record_by_button = True
    capture = play(*anna(skeleton, swing(skeleton, ("head",), 60)))
    monkeypatch.setattr(part("jobs.activity"), "current", lambda: capture)
    assert not bpy.ops.perfanim.record.poll()  # nothing is captured yet
    tick(capture, 11)
    assert capture.line == "rehearsing, nothing is recorded"
    bpy.context.scene.frame_set(20)
    for ticks in (8, 5, 4, 3):  # recorded, not, recorded, not
        assert bpy.ops.perfanim.record() == {"FINISHED"}
        tick(capture, ticks)
        bpy.context.scene.frame_set(50)
    text, poses = capture.keep(bpy.context), capture.run.poses
    assert text.startswith("10 frames recorded in Capture, Capture.001")
    first, second = (bpy.data.actions[name] for name in ("Capture", "Capture.001"))
    spans = [tuple(np.round(action.frame_range, 2)) for action in (first, second)]
    assert spans == [(20.0, 26.0), (50.0, 52.0)]
    assert first.use_fake_user or first.users  # the second does not push it out of the file
    # poses that came with the tick of the click are of before it
    ((take, _, span),) = play.marked
    assert (take, span) == ("a.perftake", (poses[11].number, poses[26].number))


def test_a_rehearsal_without_a_recording_keeps_the_scene_as_it_was(chosen: Any, play: Any, skeleton: Any) -> None:
    chosen.record_by_button = True
    capture = play(*anna(skeleton, swing(skeleton, ("head",), 60)))
    tick(capture, 9)
    assert capture.keep(bpy.context) == ""
    assert len(bpy.data.actions) == 0


def test_one_arm_is_captured_while_the_rest_plays_its_own_animation(
    part: Any, chosen: Any, play: Any, skeleton: Any, armature: Any
) -> None:
    live, running, name = part("capture.live_capture"), part("jobs.activity"), armature.name
    bpy.context.scene.render.fps = 60
    nod = swing(skeleton, ("head", "lradius", "rradius"), 100)
    still = np.tile([0.0, 1.0, 0.0], (100, 1))
    part("animation.actions").write_action(name, np.arange(1.0, 101.0), nod, still, skeleton, name="Nod")
    alone = {
        frame: {bone: quaternion_at(armature, bone, frame) for bone in ("head", "forearm.R")} for frame in (31, 60)
    }
    chosen.body_parts = {"ARM_L"}
    bpy.context.scene.frame_set(30)
    capture = play(*anna(skeleton, swing(skeleton, ("lradius", "lfemur", "head"), 200)[::2]))
    running.begin(bpy.context, capture, 1.0)
    tick(capture, 32)  # the first begins it
    arm = np.array(armature.pose.bones["forearm.L"].rotation_quaternion)
    assert abs(arm[1:]).max() > 0.1
    for frame, bones in alone.items():  # the timeline is played while live
        for bone, expected in bones.items():
            np.testing.assert_allclose(quaternion_at(armature, bone, frame), expected, atol=1e-6)
        np.testing.assert_array_equal(armature.pose.bones["forearm.L"].rotation_quaternion, arm)
    assert np.allclose(armature.pose.bones["thigh.L"].rotation_quaternion, (1, 0, 0, 0))
    text = running.finish(bpy.context)  # which ticks once more

    assert text.startswith(f"{len(capture.run.poses)} frames recorded")
    assert live._after_frame_change not in bpy.app.handlers.frame_change_post
    assert [track.name for track in armature.animation_data.nla_tracks] == ["Nod", "Capture"]
    for frame, bones in alone.items():
        for bone, expected in bones.items():
            np.testing.assert_allclose(quaternion_at(armature, bone, frame), expected, atol=1e-6)
    np.testing.assert_allclose(quaternion_at(armature, "forearm.L", 60), arm, atol=1e-6)  # the 31st pose, from frame 30
    np.testing.assert_allclose(quaternion_at(armature, "thigh.L", 60), (1, 0, 0, 0), atol=1e-6)


def test_parts_of_a_foreign_rig_take_the_bones_between(part: Any, skeleton: Any, armature: Any) -> None:
    plans, parts = part("character.retarget_plans"), part("character.part_bones")
    product = plans.plan_for(armature, skeleton)
    assert parts.bones_of_parts(armature, product, parts.PARTS) is None
    by_part = {one: parts.bones_of_parts(armature, product, {one}) for one in parts.PARTS}
    assert frozenset().union(*by_part.values()) == set(NAMINGS["blender"].values())
    assert sum(map(len, by_part.values())) == len(skeleton)  # each bone in one part
    bpy.context.view_layer.objects.active = armature
    for bone in armature.data.bones:
        bone.name = "Rig " + bone.name
    plans.fill_map(armature)
    retargeter = plans.plan_for(armature, skeleton)
    assert product.is_direct and not retargeter.is_direct
    for one, bones in by_part.items():
        found = parts.bones_of_parts(armature, retargeter, {one})
        assert found == {"Rig " + bone for bone in bones if "Rig " + bone in retargeter.bones}


@pytest.mark.usefixtures("as_recorded")
@pytest.mark.parametrize("way_out", ["closed window", "file load"])
def test_what_is_recorded_is_kept_when_blender_takes_the_capture_down(
    part: Any, new_capture: Any, way_out: str
) -> None:
    running, operator = part("jobs.activity"), part("operators.capture_operators").PERFANIM_OT_start_capture
    capture = new_capture()
    running.begin(bpy.context, capture, 1.0)
    tick_poses(capture, 10)
    keys: list[int] = []

    def count_keys(*_: object) -> None:
        for action in bpy.data.actions:
            animated = next(obj for obj in bpy.data.objects if obj.animation_data and obj.animation_data.action)
            assert animated.animation_data.action is action
            keys.extend({len(curve.keyframe_points) for curve in curves_of(animated)})

    if way_out == "closed window":
        operator.cancel(SimpleNamespace(_capture=capture, bl_label="Capture"), bpy.context)
        count_keys()
    else:
        bpy.app.handlers.load_pre.append(count_keys)  # after the add-on's own, while the data is still there
        try:
            bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        finally:
            if count_keys in bpy.app.handlers.load_pre:  # loading removes handlers that are not persistent
                bpy.app.handlers.load_pre.remove(count_keys)
    assert keys == [len(capture.run.poses)]
    assert part("take_library").listed()[0].complete
    assert part("take_library").cut_off() == []  # what is in an action is not offered
    assert running.current() is None


def test_a_character_deleted_while_capturing_does_not_lose_the_take(
    chosen: Any, errors: Any, play: Any, skeleton: Any
) -> None:
    capture = play(*anna(skeleton, swing(skeleton, ("head",), 60)))
    tick(capture, 10)
    bpy.data.objects.remove(chosen.armature)
    with pytest.raises(errors.CharacterError, match="there is no object"):
        tick(capture, 10)
    text = capture.keep(bpy.context)
    assert "frames recorded" in text
    assert len(bpy.data.actions) == 1


def test_a_new_character_takes_the_place_of_a_deleted_one_and_its_body(chosen: Any, part: Any, skeleton: Any) -> None:
    name = part("capture.performer_targets").add_character(bpy.context, skeleton)
    part("character.selection").select_only(bpy.context, [chosen.armature])
    bpy.ops.object.delete()
    assert f"{name} body" in bpy.context.scene.objects  # it was not selected
    added = part("capture.performer_targets").add_character(bpy.context, skeleton)
    assert [obj.name for obj in bpy.context.scene.objects if obj.type == "MESH"] == [f"{added} body"]


def test_frames_whose_time_stands_still_leave_the_keys_steady(chosen: Any, play: Any, skeleton: Any) -> None:
    bpy.context.scene.render.fps = 60
    poses, performer = anna(skeleton, swing(skeleton, ("head",), 8))
    poses[3] = poses[4] = poses[2]
    capture = play(poses, performer)
    tick(capture, 8)
    capture.keep(bpy.context)
    np.testing.assert_allclose(key_times(curves_of(chosen.armature)), np.arange(1.0, 8.0), atol=1e-3)
    found = [quaternion_at(chosen.armature, "head", frame) for frame in (4, 5)]
    true = [
        pose.performers[0].rotations[skeleton.index("head")]
        for pose in anna(skeleton, swing(skeleton, ("head",), 8))[0]
    ]
    np.testing.assert_allclose(found, true[3:5], atol=1e-4)


class Refinement:
    """Stands for `LiveRefinement`."""

    def __init__(self, take: str, database: str, python: str | None) -> None:
        self.take, self.database = take, database
        self.seconds: list[float] = []
        self.is_closed = False

    def tick(self, seconds: float) -> bool:
        self.seconds.append(seconds)
        return False

    def close(self) -> None:
        self.is_closed = True


@pytest.mark.long
def test_image_folders_are_captured_to_their_end(
    part: Any, chosen: Any, new_capture: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = open_simulated({"kind": "simulated", "behaviour": "walking", "seconds": 3.0, "height_m": 1.75})
    count = 30
    for number in range(200, 200 + count):
        for side, image in zip(("left", "right"), source.frame(number).images, strict=True):
            (tmp_path / side).mkdir(exist_ok=True)
            assert cv2.imwrite(str(tmp_path / side / f"{number}.jpg"), image)
    save_rig(source.rig, tmp_path / "cameras.toml")
    save_subject(source.subject, tmp_path / "subject.toml")
    chosen.source = "IMAGES"
    chosen.left_folder, chosen.right_folder = str(tmp_path / "left"), str(tmp_path / "right")
    chosen.calibration, chosen.subject = str(tmp_path / "cameras.toml"), str(tmp_path / "subject.toml")
    monkeypatch.setattr(part("capture.live_capture"), "LiveRefinement", Refinement)
    with closing(new_capture()) as capture:
        tick_until(capture, lambda: capture.done)
        text = capture.keep(bpy.context)
    assert capture.run.error is None
    assert text.startswith(f"{count} frames recorded")
    refinement = capture._refinement
    assert refinement.is_closed
    assert (refinement.take, refinement.database) == (capture.take_path, capture.setup.request.database)
    assert refinement.seconds == sorted(refinement.seconds)
    assert 0.0 <= refinement.seconds[-1] <= capture.run.poses[-1].time_s - capture.run.poses[0].time_s
    assert capture.run.statistics.handed_over == count


def test_the_last_take_is_drawn_in_time_with_the_next(part: Any, chosen: Any, play: Any, skeleton: Any) -> None:
    ghost, overlay = part("viewport.ghost"), part("viewport.overlay")
    rotations = swing(skeleton, ("lhumerus", "head"), 60)
    poses, performer = anna(skeleton, rotations)
    first = play(poses, performer)
    tick(first, 31)
    first.keep(bpy.context)
    first.close()
    last = ghost.last()
    expected, _ = forward_kinematics(skeleton, rotations[:30], np.tile([0.0, 1.0, 0.0], (30, 1)))
    for number in (0, 7, 29):
        ((body, joints_m),) = last.at(number / 60.0 - 1e-6)
        assert body.names == skeleton.names
        np.testing.assert_allclose(joints_m, expected[number], atol=1e-5)
    assert last.at(0.6) == []  # it is over
    second = play(poses, performer)
    drawn: list[float] = []
    chosen.overlay = {"GHOST"}
    scene = overlay.Scene.of([performer], None, lambda points_m: points_m, ghost=last)
    chosen.record_by_button = True
    tick(second, 1)
    second._drawn = scene
    tick(second, 10)
    drawn.append(overlay._state.elapsed_s)  # rehearsing: in its first pose
    second.record(chosen)
    tick(second, 13)
    drawn.append(overlay._state.elapsed_s)
    assert drawn == [0.0, pytest.approx(11 / 60.0)]
    shapes, _ = overlay.shapes_of(scene, poses[0], frozenset({"GHOST"}), lambda points_m: points_m[..., :2], 1.0, 0.1)
    assert set(shapes.colours) == {overlay._GHOST_COLOUR}
    overlay.hide()
    second.close()
    bpy.ops.wm.read_homefile(use_empty=True)
    assert ghost.last() is None
