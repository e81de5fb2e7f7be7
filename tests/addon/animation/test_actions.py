"""Recorded poses as actions: what is written is what plays, and nothing that was there is lost."""

import bpy
import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import CharacterError
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.perfanim_addon.animation import actions
from perfanim.perfanim_addon.animation.action_placement import Placement
from perfanim.perfanim_addon.animation.keyframes import KeyBounds
from played import curves_of, key_times, played_poses, points_from_blender

SKELETON = default_skeleton(1.68)


@pytest.fixture
def performer(made: str) -> str:
    """The one character, without animation."""
    bpy.data.objects[made].animation_data_clear()
    for action in list(bpy.data.actions):
        bpy.data.actions.remove(action)
    return made


def smooth_motion(count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (F, 29, 4) that swing on and turn several times around, so quaternion signs must flip; roots (F, 3)."""
    random = np.random.default_rng(seed)
    phase = 0.15 * np.arange(count)[:, None, None]
    vectors = random.normal(size=(29, 3)) * np.sin(phase + random.normal(size=(29, 3)))
    vectors[:, 0] = [0.0, 1.0, 0.0] * phase[:, 0]
    wrapped = rot.from_rotation_vector(vectors)
    return np.where(wrapped[..., :1] < 0.0, -wrapped, wrapped), np.cumsum(random.normal(size=(count, 3)), axis=0)


def test_written_poses_are_read_back(performer):
    rotations, roots = smooth_motion(240)
    frames = 10.0 + 0.4 * np.arange(240)
    name = actions.write_action(performer, frames, rotations, roots, SKELETON, name="walk-01")
    found, found_roots = played_poses(performer, frames, SKELETON)
    assert name == "walk-01"
    assert np.max(np.degrees(rot.angle_between(found, rotations))) < 0.01
    assert np.max(np.abs(found_roots - roots)) < 1e-4
    assert np.allclose(key_times(curves_of(bpy.data.objects[performer])), frames, atol=1e-4)


def test_playing_the_action_moves_the_bones(performer):
    rotations, roots = smooth_motion(5)
    actions.write_action(performer, np.arange(1, 6), rotations, roots, SKELETON)
    for frame in (1, 4):
        bpy.context.scene.frame_set(frame)
        obj = bpy.data.objects[performer].evaluated_get(bpy.context.evaluated_depsgraph_get())
        heads = points_from_blender([obj.pose.bones[name].head for name in NAMINGS["blender"].values()])
        expected, _ = forward_kinematics(SKELETON, rotations[frame - 1], roots[frame - 1])
        assert np.max(np.linalg.norm(heads - expected, axis=1)) < 1e-4


def test_quaternions_keep_to_one_hemisphere(performer):
    rotations, roots = smooth_motion(300)
    actions.write_action(performer, np.arange(300), rotations, roots, SKELETON)
    curves = curves_of(bpy.data.objects[performer])
    path = 'pose.bones["hips"].rotation_quaternion'
    keys = np.array([[key.co[1] for key in curve.keyframe_points] for curve in curves if curve.data_path == path]).T
    assert keys.shape == (300, 4)
    assert np.all(np.sum(keys[1:] * keys[:-1], axis=1) > 0.9)
    # half way between two keys the pose lies between them, too: no flips while playing in slow motion
    between, _ = played_poses(performer, np.arange(299) + 0.5, SKELETON)
    assert np.max(rot.angle_between(between, rotations[:-1])) < 0.6 * np.max(
        rot.angle_between(rotations[1:], rotations[:-1])
    )


def test_channels_are_grouped_by_bone_and_straight(performer):
    rotations, roots = smooth_motion(3)
    actions.write_action(performer, [1, 2, 3], rotations, roots, SKELETON)
    curves = curves_of(bpy.data.objects[performer])
    assert len(curves) == 4 * 29 + 3
    for curve in curves:
        assert curve.data_path.startswith(f'pose.bones["{curve.group.name}"].')
        assert {key.interpolation for key in curve.keyframe_points} == {"LINEAR"}


def test_sparse_keys_are_eased(performer):
    rotations, roots = smooth_motion(3)
    actions.write_action(performer, [1, 11, 21], rotations, roots, SKELETON)
    curve = curves_of(bpy.data.objects[performer])[0]
    assert {key.interpolation for key in curve.keyframe_points} == {"BEZIER"}


def test_doubtful_poses_of_almost_one_time_are_marked(performer):
    """Blender makes one key of two that lie so close together, as poses that come in a burst do."""
    rotations, roots = smooth_motion(4)
    frames, how = np.array([1.0, 2.0, 2.001, 3.0]), Placement(marked=(2.0, 2.001))
    actions.write_action(performer, frames, rotations, roots, SKELETON, placement=how)
    for curve in curves_of(bpy.data.objects[performer]):
        assert [(round(key.co.x), key.type) for key in curve.keyframe_points] == [
            (1, "KEYFRAME"), (2, "JITTER"), (3, "KEYFRAME"),
        ]  # fmt: skip


@pytest.mark.parametrize("bounds", [None, KeyBounds(0.5, 2.0)])
def test_bones_of_doubtful_parts_are_marked_or_left_out_alone(performer, bounds):
    rotations, roots = smooth_motion(40)
    frames, doubtful = np.arange(1.0, 41.0), {"lradius": (1.0, 11.0, 12.0, 13.0)}
    for leave_out in (False, True):
        how = Placement(bounds=bounds, doubtful=doubtful, leave_out=leave_out)
        actions.write_action(performer, frames, rotations, roots, SKELETON, placement=how)
        for curve in curves_of(bpy.data.objects[performer]):
            keys = {round(key.co.x): key.type for key in curve.keyframe_points}
            marked = {frame for frame, kind in keys.items() if kind == "JITTER"}
            expected = {1, 11, 12, 13} if curve.group.name == "lradius" else set()
            assert marked == expected & ({1} if leave_out else set(keys))
            if bounds is None:
                assert len(keys) == (37 if leave_out and expected else 40)


def test_the_earlier_action_is_kept(performer, tmp_path):
    rotations, roots = smooth_motion(4)
    first = actions.write_action(performer, [1, 2, 3, 4], rotations, roots, SKELETON, name="take")
    bpy.data.actions[first].use_fake_user = False
    second = actions.write_action(performer, [1, 2, 3, 4], rotations, roots, SKELETON, name="take")
    assert bpy.data.objects[performer].animation_data.action.name == second != first
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "takes.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "takes.blend"))
    assert {first, second} <= set(bpy.data.actions.keys())
    found, _ = played_poses(performer, [1, 2, 3, 4], SKELETON)
    assert np.max(np.degrees(rot.angle_between(found, rotations))) < 0.01


@pytest.mark.skipif(bpy.app.version < (4, 4, 0), reason="actions have no slots before Blender 4.4")
def test_a_slot_is_assigned(performer):
    rotations, roots = smooth_motion(2)
    actions.write_action(performer, [1, 2], rotations, roots, SKELETON)
    animation = bpy.data.objects[performer].animation_data
    assert animation.action_slot.identifier == f"OB{performer}"
    assert len(animation.action.slots) == 1


def test_times_become_scene_frames(performer):
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 30, 1.001
    frames = actions.scene_frames([2.0, 2.0 + 1.001, 2.0 + 2.002], scene, start_frame=101.0)
    assert np.allclose(frames, [101.0, 131.0, 161.0])
    assert len(actions.scene_frames([], scene)) == 0


def test_bones_in_euler_angles_play_quaternions(performer):
    bpy.data.objects[performer].pose.bones["head"].rotation_mode = "XYZ"
    rotations, roots = smooth_motion(2)
    actions.write_action(performer, [1, 2], rotations, roots, SKELETON)
    assert bpy.data.objects[performer].pose.bones["head"].rotation_mode == "QUATERNION"


def test_poses_with_nan_leave_no_action(performer):
    rotations, roots = smooth_motion(3)
    rotations[1, 3, 0] = np.nan
    with pytest.raises(CharacterError, match="finite"):
        actions.write_action(performer, [1, 2, 3], rotations, roots, SKELETON)
    assert len(bpy.data.actions) == 0
