"""Where keyframes go: strips and layers over what an armature plays, some bones alone, fewer keys."""

import bpy
import numpy as np
import pytest
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import CharacterError
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.perfanim_addon.animation import actions
from perfanim.perfanim_addon.animation.action_placement import Placement, PlacementMode
from perfanim.perfanim_addon.animation.keyframes import KeyBounds
from perfanim.perfanim_addon.capture.armature_driver import ArmatureDriver
from played import curves_of, played_poses

SKELETON = default_skeleton(1.68)
FLOAT32_DEG = 0.01
STRIP, LAYER = Placement(PlacementMode.STRIP), Placement(PlacementMode.LAYER)


@pytest.fixture
def performer(made: str) -> str:
    """The one character, as it was made."""
    obj = bpy.data.objects[made]
    obj.animation_data_clear()
    obj.scale = (1.0, 1.0, 1.0)
    for bone in obj.pose.bones:
        bone.rotation_mode = "QUATERNION"
        bone.matrix_basis.identity()
    for action in list(bpy.data.actions):
        bpy.data.actions.remove(action)
    bpy.context.scene.render.fps = 24
    return made


def swinging(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (F, 29, 4) that swing, roots (F, 3)."""
    random = np.random.default_rng(seed)
    vectors = (
        0.5 * random.normal(size=(29, 3)) * np.sin(0.1 * np.arange(count)[:, None, None] + random.normal(size=(29, 3)))
    )
    return rot.from_rotation_vector(vectors), np.cumsum(0.01 * random.normal(size=(count, 3)), axis=0)


def write(performer, frames, motion, placement, name="take"):
    return actions.write_action(performer, frames, *motion, SKELETON, name=name, placement=placement)


def off_deg(performer, frames, rotations):
    found, _ = played_poses(performer, frames, SKELETON)
    return np.degrees(rot.angle_between(found, rotations)).max()


def tracks(performer):
    return [(track.name, [strip.name for strip in track.strips]) for track in _animation(performer).nla_tracks]


def _animation(performer):
    return bpy.data.objects[performer].animation_data


@pytest.mark.parametrize("start", [1.0, 10.4])
def test_a_strip_plays_what_was_recorded_where_it_was_recorded(performer, start):
    frames, motion = start + 0.4 * np.arange(50), swinging(50, 1)
    name = write(performer, frames, motion, STRIP)
    assert _animation(performer).action is None
    assert tracks(performer) == [(name, [name])]
    assert off_deg(performer, frames[1:-1], motion[0][1:-1]) < FLOAT32_DEG
    assert off_deg(performer, [frames[0] + 1e-3], motion[0][:1]) < 0.1


def test_a_strip_leaves_what_was_played_below_it(performer):
    first, second = swinging(60, 1), swinging(20, 2)
    write(performer, np.arange(1, 61), first, Placement(), "walk")
    write(performer, np.arange(21, 41), second, STRIP, "jump")
    assert tracks(performer) == [("walk", ["walk"]), ("jump", ["jump"])]
    assert off_deg(performer, np.arange(1, 21), first[0][:20]) < FLOAT32_DEG
    assert off_deg(performer, np.arange(22, 40), second[0][1:-1]) < FLOAT32_DEG
    assert off_deg(performer, np.arange(42, 61), first[0][41:]) < FLOAT32_DEG
    write(performer, np.arange(51, 56), second_part := (second[0][:5], second[1][:5]), STRIP, "hop")
    assert off_deg(performer, np.arange(52, 55), second_part[0][1:-1]) < FLOAT32_DEG


def test_a_layer_blends_in_and_out_over_what_was_played(performer):
    first, second = swinging(80, 1), swinging(40, 2)
    write(performer, np.arange(1, 81), (first[0], first[1]), Placement(), "walk")
    write(performer, np.arange(21, 61), (-second[0], second[1]), LAYER, "wave")  # q and -q are the same turn
    blend = int(LAYER.blend_s * 24)
    assert off_deg(performer, np.arange(1, 22), first[0][:21]) < 0.1
    assert off_deg(performer, np.arange(21 + blend, 61 - blend), second[0][blend : 40 - blend]) < FLOAT32_DEG
    assert off_deg(performer, np.arange(62, 81), first[0][61:]) < FLOAT32_DEG
    # half way in the pose lies between both: neither far from the one nor a turn around
    found, _ = played_poses(performer, [21 + blend // 2], SKELETON)
    apart = rot.angle_between(first[0][20 + blend // 2], second[0][blend // 2])
    for end in (first[0][20 + blend // 2], second[0][blend // 2]):
        assert np.all(rot.angle_between(found[0], end) <= 0.6 * apart + 0.01)


@pytest.mark.parametrize("bounds", [None, KeyBounds(0.2, 1.0)])
def test_a_layer_that_turns_once_around_blends_back_the_short_way(performer, bounds):
    frames = np.arange(11, 71)
    still = rot.identity((29,))
    around = np.tile(still, (60, 1, 1))
    around[:, 0] = rot.from_rotation_vector(np.linspace(0.0, 2.0 * np.pi, 60)[:, None] * [0.0, 1.0, 0.0])
    write(performer, [1, 90], (np.tile(still, (2, 1, 1)), np.zeros((2, 3))), Placement(), "stand")
    write(performer, frames, (around, np.zeros((60, 3))), Placement(PlacementMode.LAYER, bounds=bounds), "turn")
    found, _ = played_poses(performer, np.arange(1, 90), SKELETON)
    wanted = np.tile(still, (89, 1, 1))
    wanted[10:70] = around
    blend = int(LAYER.blend_s * 24)
    assert np.degrees(rot.angle_between(found, wanted))[10 + blend : 70 - blend].max() < 0.2 + FLOAT32_DEG
    # in the blends the body stands between the turn, which is 37 degrees from its end there, and standing still
    assert np.degrees(rot.angle_between(found, wanted)).max() < 37.0


def test_only_some_bones_are_moved(performer):
    first, second = swinging(40, 1), swinging(40, 2)
    arm = ["upper_arm.L", "forearm.L"]
    write(performer, np.arange(1, 41), first, Placement(), "walk")
    name = write(performer, np.arange(1, 41), second, Placement(PlacementMode.STRIP, only=arm), "wave")
    found, roots = played_poses(performer, np.arange(2, 40), SKELETON)
    np.testing.assert_allclose(roots, first[1][1:-1], atol=1e-5)
    for joint, bone in enumerate(NAMINGS["blender"][name] for name in SKELETON.names):
        wanted = (second if bone in arm else first)[0][1:-1, joint]
        assert np.degrees(rot.angle_between(found[:, joint], wanted)).max() < FLOAT32_DEG, bone
    with pytest.raises(CharacterError, match="none of the selected bones"):
        write(performer, np.arange(1, 41), second, Placement(only=["nose"]))
    assert set(bpy.data.actions.keys()) == {"walk", name}


@pytest.mark.parametrize(
    ("mode", "onto"), [("XYZ", PlacementMode.STRIP), ("ZXY", PlacementMode.LAYER), ("AXIS_ANGLE", PlacementMode.STRIP)]
)
def test_what_was_keyed_in_other_angles_still_plays(performer, mode, onto):
    obj = bpy.data.objects[performer]
    bone = obj.pose.bones["head"]
    bone.rotation_mode = mode
    channel, values = (
        ("rotation_axis_angle", (0.4, 0, 0, 1)) if mode == "AXIS_ANGLE" else ("rotation_euler", (0.5, 0.3, -2.9))
    )
    for frame, scale in ((1, 0.0), (31, 1.0)):
        setattr(bone, channel, [scale * value for value in values] if mode != "AXIS_ANGLE" else (scale * 0.4, 0, 0, 1))
        bone.keyframe_insert(channel, frame=frame)

    def head(frame):
        bpy.context.scene.frame_set(frame)
        evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        return np.array(evaluated.pose.bones["head"].matrix)

    before = [head(frame) for frame in range(1, 32)]
    if mode == "ZXY":  # as after a capture, which has turned the bones before
        driver = ArmatureDriver(performer, SKELETON)
        driver.apply(*(part[0] for part in swinging(1, 3)))
        assert bone.rotation_mode == "QUATERNION"
    write(performer, np.arange(41, 61), swinging(20, 2), Placement(onto))
    assert bone.rotation_mode == "QUATERNION"
    for frame, matrix in enumerate(before, start=1):
        np.testing.assert_allclose(head(frame), matrix, atol=1e-4)


def test_fewer_keys_stay_within_the_bounds(performer):
    obj = bpy.data.objects[performer]
    obj.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    rotations, roots = swinging(120, 3)
    frames = 4.0 + 0.4 * np.arange(120)
    bounds = KeyBounds(0.5, 3.0)
    write(performer, frames, (rotations, np.cumsum(roots, axis=0)), Placement(bounds=bounds))
    found, moved = played_poses(performer, frames, SKELETON)
    assert np.degrees(rot.angle_between(found, rotations)).max() <= bounds.rotation_deg + FLOAT32_DEG
    in_scene_mm = 1e3 * 2.0 * np.linalg.norm(moved - np.cumsum(roots, axis=0), axis=1)
    assert in_scene_mm.max() <= bounds.location_mm + 0.1
    curves = curves_of(obj)
    counts = {(curve.data_path): len(curve.keyframe_points) for curve in curves}
    assert sum(counts.values()) < 0.5 * len(counts) * 120
    for curve in curves:
        assert len(curve.keyframe_points) == counts[curve.data_path]  # one bone's curves have their keys together
        assert {key.interpolation for key in curve.keyframe_points} == {"BEZIER"}


def test_one_pose_alone_can_be_written_everywhere(performer):
    rotations, roots = swinging(1, 3)
    for placement in (Placement(bounds=KeyBounds(1.0, 1.0)), STRIP, LAYER):
        write(performer, [5.0], (rotations, roots), placement)
    assert len(tracks(performer)) == 3


def test_nothing_is_written_while_a_strip_is_edited(performer):
    write(performer, np.arange(1, 11), swinging(10, 1), STRIP)
    animation = _animation(performer)
    animation.nla_tracks[0].strips[0].select = True
    animation.nla_tracks.active = animation.nla_tracks[0]
    animation.use_tweak_mode = True
    if not animation.use_tweak_mode:
        pytest.skip("this Blender enters tweak mode in its editor alone")
    with pytest.raises(CharacterError, match="leave tweak mode"):
        write(performer, np.arange(1, 11), swinging(10, 1), STRIP)
