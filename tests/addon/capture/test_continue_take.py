"""Takes put one after the other: place, heading and pose go on, and feet stay where they stand."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from heroes import clip, open_hero
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.scene_pose import ScenePose
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from solved_poses import performer_pose, write_poses

CUT = 100  # playhead at which the second take begins


def take(folder: Path, name: str, motion: Motion) -> Path:
    poses = [
        ScenePose((performer_pose(n, motion.rotations[n], tuple(motion.root_positions_m[n])),))
        for n in range(motion.frames)
    ]
    return write_poses(folder, name, [Subject(name, motion.skeleton, load_marker_set("boxing"))], poses)


def heads(armature_object: Any, bones: list[str], frames: range) -> np.ndarray:
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        posed = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found.append([posed.matrix_world @ posed.pose.bones[name].head for name in bones])
    return np.array(found)


@pytest.mark.parametrize("own", [True, False])
def test_the_second_take_begins_where_the_first_is(
    chosen: Any, tmp_path: Path, own: bool, request: pytest.FixtureRequest
) -> None:
    if not own:
        request.getfixturevalue("addon")
        chosen_character = open_hero(request.getfixturevalue("mixamo_blend"))
        bpy.context.scene.perfanim.armature = chosen_character
    scene = bpy.context.scene
    scene.render.fps = 60
    first, second = clip("walking-01-neutral", 160), clip("boxing-01-neutral", 120)
    turn = rot.from_rotation_vector(np.array([0.0, 1.2, 0.0]))
    rotations = second.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, rotations[:, 0])
    second = Motion(
        "b",
        second.fps,
        second.skeleton,
        rotations,
        rot.rotate(turn, second.root_positions_m) + np.array([1.0, 0.0, 2.0]),
    )
    scene.perfanim.feet, scene.perfanim_result.filters = "off", "CHOSEN"
    scene.frame_set(1)
    assert bpy.ops.perfanim.play_take(path=str(take(tmp_path, "a", first))) == {"FINISHED"}
    armature_object = scene.perfanim.armature
    foreign = ("mixamorig:Hips", ["mixamorig:LeftToeBase", "mixamorig:RightToeBase"])
    hips, feet = ("hips", ["toes.L", "toes.R"]) if own else foreign
    before = heads(armature_object, [hips, *feet], range(1, CUT + 1))
    scene.frame_set(CUT)
    scene.perfanim_result.continue_here, scene.perfanim_result.blend_frames = True, 45
    assert bpy.ops.perfanim.play_take(path=str(take(tmp_path, "b", second))) == {"FINISHED"}
    shown = heads(armature_object, [hips, *feet], range(1, CUT + 100))
    assert np.allclose(shown[: CUT - 1], before[: CUT - 1], atol=1e-4)  # the first take is kept
    seam = np.linalg.norm(np.diff(shown[CUT - 4 : CUT + 60, 0], 2, axis=0), axis=-1).max()
    own_m = max(np.linalg.norm(np.diff(each.root_positions_m, 2, axis=0), axis=-1).max() for each in (first, second))
    assert seam <= 1.5 * own_m
    speeds = np.linalg.norm(np.diff(shown[CUT - 3 : CUT + 1, 0], axis=0), axis=-1)  # in the frames around the playhead
    assert np.ptp(speeds) < 0.3 * speeds[0]  # it does not stop there
    for foot in (1, 2):  # a foot that stands at the playhead does not slide away
        toes = shown[CUT - 3 : CUT + 60, foot]
        steps = np.linalg.norm(np.diff(toes[:, :2], axis=0), axis=-1)
        low = toes[1:, 2] < toes[:, 2].min() + 0.004
        assert np.percentile(steps[low], 90) < 0.004


def test_without_an_animation_a_take_is_put_as_ever(chosen: Any, tmp_path: Path) -> None:
    bpy.context.scene.perfanim_result.continue_here = True
    motion = sliced(clip("walking-01-neutral", 20), 0, 20)
    assert bpy.ops.perfanim.play_take(path=str(take(tmp_path, "a", motion))) == {"FINISHED"}
    assert chosen.armature.animation_data.action is not None or len(chosen.armature.animation_data.nla_tracks) == 1
