"""Clean Up Motion: edits of a character's keyed action, each undone by one step."""

from typing import Any

import bpy
import numpy as np
import pytest
from heroes import clip
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.skeleton import forward_kinematics
from played import curves_of, key_times

FRAMES = np.arange(1.0, 61.0)


@pytest.fixture
def walker(part: Any, chosen: Any) -> Any:
    """A character of the product's own that walks in an action of sixty frames."""
    motion = clip("walking-01-neutral", 60)
    name = part("character.create_character").create_character(bpy.context, motion.skeleton)
    chosen.armature = bpy.data.objects[name]
    bpy.context.scene.render.fps = 60
    part("animation.actions").write_action(
        name, FRAMES, motion.rotations, motion.root_positions_m, motion.skeleton, name="Walk"
    )
    return chosen.armature


def places(armature_object: Any, bone: str, frames: Any) -> np.ndarray:
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        posed = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found.append(posed.pose.bones[bone].head.copy())
    return np.array(found)


def run(name: str, **values: Any) -> None:
    assert getattr(bpy.ops.perfanim, name)("EXEC_DEFAULT", **values) == {"FINISHED"}


def test_a_motion_that_is_read_and_written_stays_the_same(part: Any, walker: Any) -> None:
    module = part("animation.character_action")
    before = {bone: places(walker, bone, (1, 30, 60)) for bone in ("hips", "hand.L", "toes.R", "head")}
    read = module.read_character_action(walker)
    module.write_character_action(read, read.motion, read.frames)
    for bone, wanted in before.items():
        assert np.allclose(places(walker, bone, (1, 30, 60)), wanted, atol=1e-5), bone


def test_trim_and_shift_move_the_keys(walker: Any) -> None:
    before = places(walker, "hand.L", (20, 40))
    run("trim_motion", first=20, last=40)
    times = key_times(curves_of(walker))
    assert (times[0], times[-1], len(times)) == (20.0, 40.0, 21)
    assert np.allclose(places(walker, "hand.L", (20, 40)), before, atol=1e-5)
    run("shift_motion", first=101)
    assert np.allclose(places(walker, "hand.L", (101, 121)), before, atol=1e-5)
    with pytest.raises(RuntimeError, match="nothing of the motion would be left"):
        bpy.ops.perfanim.trim_motion("EXEC_DEFAULT", first=500, last=600)


def test_trim_proposes_the_end_of_the_t_pose(part: Any, walker: Any) -> None:
    motion = clip("walking-01-neutral", 60)
    rotations = motion.rotations.copy()
    rotations[:30] = t_pose(motion.skeleton)
    part("animation.actions").write_action(
        walker.name, FRAMES, rotations, motion.root_positions_m, motion.skeleton, name="T"
    )
    assert bpy.ops.perfanim.trim_motion() == {"FINISHED"}
    assert key_times(curves_of(walker))[0] == pytest.approx(55.0, abs=1.0)  # and the time to lower the arms


def test_mirror_exchanges_left_and_right(walker: Any) -> None:
    hips, left, right = (places(walker, bone, (1, 30)) for bone in ("hips", "toes.L", "toes.R"))
    run("mirror_motion")
    shown, mirrored = places(walker, "hips", (1, 30)), places(walker, "toes.R", (1, 30))
    assert np.allclose(shown[0], hips[0], atol=1e-5)
    assert np.allclose(mirrored[..., 2], left[..., 2], atol=2e-3)
    assert not np.allclose(left[..., 2], right[..., 2], atol=1e-2)


def test_a_pop_is_removed_and_the_rest_is_left_alone(walker: Any, message: Any) -> None:
    before = places(walker, "hand.L", FRAMES)
    (curve,) = [
        c
        for c in curves_of(walker)
        if c.data_path == 'pose.bones["upper_arm.L"].rotation_quaternion' and c.array_index == 1
    ]
    for row in (29, 30):
        curve.keyframe_points[row].co[1] += 0.5
    curve.update()
    popped = places(walker, "hand.L", FRAMES)
    assert np.abs(popped - before).max() > 0.1
    run("remove_pop", first=29, last=32)
    assert message("clean_up") == "Remove Pop: frames 29 to 32 of Walk"
    after = places(walker, "hand.L", FRAMES)
    assert np.abs(after - before).max() < 0.02
    assert np.allclose(np.delete(after, range(27, 33), 0), np.delete(before, range(27, 33), 0), atol=1e-4)


def test_smoothing_takes_the_jitter_from_a_range(walker: Any) -> None:
    random = np.random.default_rng(1)
    for curve in curves_of(walker):
        if "upper_arm.L" in curve.data_path:
            for key in curve.keyframe_points:
                key.co[1] += random.normal(0.0, 0.01)
            curve.update()
    rough = places(walker, "hand.L", FRAMES)
    run("smooth_motion", first=20, last=50, smoothing_ms=50.0)
    calm = places(walker, "hand.L", FRAMES)
    inside, outside = slice(24, 44), slice(0, 12)
    jitter = [np.linalg.norm(np.diff(each[inside], 3, axis=0), axis=1).mean() for each in (rough, calm)]
    assert jitter[1] < 0.3 * jitter[0]
    assert np.allclose(calm[outside], rough[outside], atol=1e-4)


def test_a_walk_is_repeated_without_a_pop(part: Any, chosen: Any, walker: Any, message: Any) -> None:
    motion = clip("walking-01-neutral", 240)
    part("animation.actions").write_action(
        walker.name, np.arange(1.0, 241.0), motion.rotations, motion.root_positions_m, motion.skeleton, name="Long"
    )
    run("loop_motion", first=1, last=240, times=3)
    times = key_times(curves_of(walker))
    assert message("clean_up") == f"Loop: 3 cycles, frames 1 to {times[-1]:.0f} of Long"
    length = (len(times) - 1) // 3
    assert times[0] == 1.0 and 60 * 0.6 <= length <= 60 * 3.0
    hands = places(walker, "hand.L", times)
    steps = np.linalg.norm(np.diff(hands, 2, axis=0), axis=1)
    original = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]
    own = np.linalg.norm(np.diff(original[:, motion.skeleton.index("lhand")], 2, axis=0), axis=1)
    assert steps.max() <= 1.5 * own.max()


def test_feet_are_held(walker: Any) -> None:
    for curve in curves_of(walker):
        if curve.data_path == 'pose.bones["hips"].location' and curve.array_index == 0:
            for key in curve.keyframe_points:
                key.co[1] += 0.0005 * key.co[0]  # glides 3 cm a second
            curve.update()
    run("hold_feet", floor=False)
    toes = places(walker, "toes.L", FRAMES)
    speed = np.linalg.norm(np.diff(toes[:, :2], axis=0), axis=1)
    low = toes[1:, 2] < toes[:, 2].min() + 0.005
    assert np.percentile(speed[low], 50) < 1e-4


def test_keys_of_ones_own_in_euler_angles_are_mirrored(walker: Any) -> None:
    """An action that was keyed by hand: the left arm's angles become the right arm's."""
    walker.animation_data_clear()
    for bone in walker.pose.bones:
        bone.rotation_mode = "XYZ"
    arm = walker.pose.bones["upper_arm.L"]
    for frame, angle in ((1, 0.0), (20, 0.8)):
        arm.rotation_euler = (angle, 0.0, 0.0)
        arm.keyframe_insert("rotation_euler", frame=frame)
    for bone in walker.pose.bones:
        bone.keyframe_insert("rotation_euler", frame=1)
    walker.pose.bones["hips"].keyframe_insert("location", frame=1)
    hands = [places(walker, bone, (20,))[0] for bone in ("hand.L", "hand.R")]
    run("mirror_motion")
    mirrored = [places(walker, bone, (20,))[0] for bone in ("hand.L", "hand.R")]
    root = places(walker, "hips", (20,))[0]
    for before, after in zip(hands, reversed(mirrored), strict=True):
        assert np.allclose((after - root)[1:], (before - root)[1:], atol=2e-3)
        assert np.isclose((after - root)[0], -(before - root)[0], atol=2e-3)


def test_a_character_without_an_action_says_so(chosen: Any, new_character: Any) -> None:
    chosen.armature = new_character(clip("walking-01-neutral", 2).skeleton)
    with pytest.raises(RuntimeError, match="The character has no active action"):
        bpy.ops.perfanim.mirror_motion()
