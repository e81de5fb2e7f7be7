"""Hand poses as keys of an action, and live."""

from contextlib import closing
from typing import Any

import bpy
import numpy as np
import pytest
from heroes import clip
from perfanim.core.body.scene_pose import ScenePose
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from played import curves_of, key_times
from solved_poses import performer_pose

FRAMES = np.arange(1.0, 61.0)
FINGERS = 'pose.bones["fingers.L"].rotation_quaternion'


@pytest.fixture
def walker(part: Any, chosen: Any) -> Any:
    """A character of the product's own that walks in an action of sixty frames."""
    motion = clip("walking-01-neutral", 60)
    name = part("character.create_character").create_character(bpy.context, motion.skeleton)
    chosen.armature = bpy.data.objects[name]
    part("animation.actions").write_action(
        name, FRAMES, motion.rotations, motion.root_positions_m, motion.skeleton, name="Walk"
    )
    return chosen.armature


def bend_deg(armature_object: Any, frame: float, bone: str = "fingers.L") -> float:
    bpy.context.scene.frame_set(int(frame))
    posed = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return float(np.degrees(posed.pose.bones[bone].matrix_basis.to_quaternion().angle))


def pose_hands(frame: int, pose: str, side: str = "BOTH") -> None:
    bpy.context.scene.frame_set(frame)
    assert bpy.ops.perfanim.pose_hands("EXEC_DEFAULT", pose=pose, side=side) == {"FINISHED"}


def times(armature_object: Any, path: str = FINGERS) -> list[float]:
    (curve,) = [each for each in curves_of(armature_object) if each.data_path == path and each.array_index == 0]
    return [key.co[0] for key in curve.keyframe_points]


def test_a_pose_is_held_from_the_playhead_on_until_the_next(part: Any, walker: Any) -> None:
    pose_hands(20, "FIST")
    assert times(walker) == [15.0, 20.0]  # the take's own keys of the fingers are gone
    assert [round(bend_deg(walker, frame)) for frame in (20, 40, 60)] == [90, 90, 90]
    assert bend_deg(walker, 1) < 30.0
    pose_hands(40, "FLAT")
    assert times(walker) == [15.0, 20.0, 35.0, 40.0]
    assert [round(bend_deg(walker, frame)) for frame in (30, 40, 60)] == [90, 0, 0]
    pose_hands(20, "FLAT")  # instead of the fist
    assert times(walker) == [15.0, 20.0, 35.0, 40.0]
    assert max(bend_deg(walker, frame) for frame in (20, 30, 40)) < 1.0
    assert len(times(walker, 'pose.bones["hand.L"].rotation_quaternion')) == 60
    assert part("jobs.activity").message("hands")[0] == "Flat from frame 20 on, in Walk"


def test_a_pose_at_the_first_frame_holds_for_the_whole_take_and_one_hand_alone(walker: Any) -> None:
    before = bend_deg(walker, 30, "fingers.R")
    pose_hands(1, "FIST", "LEFT")
    assert times(walker) == [1.0]
    assert (round(bend_deg(walker, 1)), round(bend_deg(walker, 60))) == (90, 90)
    assert bend_deg(walker, 30, "fingers.R") == pytest.approx(before, abs=1e-3)


def test_cleaning_up_leaves_hand_poses(walker: Any) -> None:
    pose_hands(20, "FIST")
    assert bpy.ops.perfanim.smooth_motion("EXEC_DEFAULT", first=1, last=60) == {"FINISHED"}
    assert times(walker) == [15.0, 20.0]
    assert round(bend_deg(walker, 50)) == 90


def test_a_character_without_an_action_gets_one(part: Any, chosen: Any) -> None:
    assert not bpy.ops.perfanim.pose_hands.poll() or chosen.armature is not None
    name = part("character.create_character").create_character(bpy.context, default_skeleton())
    chosen.armature = bpy.data.objects[name]
    pose_hands(10, "GRIP")
    assert chosen.armature.animation_data.action.name == "Hands"
    assert key_times(curves_of(chosen.armature)) == [10.0]
    assert bend_deg(chosen.armature, 1) > 45.0


def test_hands_posed_live_are_shown_and_keyed_on_all_characters(
    chosen: Any, play: Any, targets: Any, new_character: Any
) -> None:
    bpy.context.scene.render.fps = 60
    bpy.context.scene.frame_set(1)
    chosen.armature, second, fingerless = (new_character(default_skeleton()) for _ in range(3))
    bpy.ops.object.mode_set(mode="EDIT")  # the last one is active
    for name in ("fingers.L", "fingers.R", "thumb.L", "thumb.R"):
        fingerless.data.edit_bones.remove(fingerless.data.edit_bones[name])
    bpy.ops.object.mode_set(mode="OBJECT")
    for further in (fingerless, second):
        entry = targets.entries.add()
        entry.kind, entry.armature = "CHARACTER", further
    poses = [ScenePose((performer_pose(number),)) for number in range(40)]
    with closing(play(poses, Subject("Anna", default_skeleton(), load_marker_set("boxing")))) as capture:
        capture.tick(bpy.context)
        for number in range(30):
            capture.tick(bpy.context)
            if number == 9:
                capture.pose_hands("fist", "l")
            if number == 11:
                for each in (chosen.armature, second):
                    assert round(np.degrees(each.pose.bones["fingers.L"].rotation_quaternion.angle)) == 90
        capture.keep(bpy.context)
    for each in (chosen.armature, second):
        assert [round(bend_deg(each, frame)) for frame in (1, 10, 25)] == [0, 90, 90]
        assert bend_deg(each, 25, "fingers.R") == pytest.approx(0.0, abs=1e-3)
    assert fingerless.animation_data.action is not None
