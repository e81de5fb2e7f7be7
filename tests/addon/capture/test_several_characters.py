"""One performer moves several characters: each from where it stands, with an action of its own."""

from contextlib import closing
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from perfanim.core.body.scene_pose import ScenePose
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from played import curves_of, key_times
from solved_poses import performer_pose, write_poses

pytestmark = pytest.mark.usefixtures("as_recorded")

SKELETON = default_skeleton(1.75)
ANNA = Subject("Anna", SKELETON, load_marker_set("boxing"))
POSES = 20


@pytest.fixture
def pair(chosen: Any, targets: Any, new_character: Any) -> tuple[Any, Any]:
    """The performer's character, and a smaller one two metres beside it that follows, too."""
    bpy.context.scene.render.fps = 60
    bpy.context.scene.frame_set(1)
    chosen.armature = new_character(SKELETON)
    second = new_character(default_skeleton(1.2))
    second.location = (2.0, 0.0, 0.0)
    entry = targets.entries.add()
    entry.kind, entry.armature = "CHARACTER", second
    return chosen.armature, second


def walk(skeleton: Skeleton) -> list[ScenePose]:
    found = []
    for number in range(POSES):
        turned = rot.identity((len(skeleton),))
        turned[skeleton.index("lhumerus")] = rot.from_rotation_vector(np.array([0.0, 0.0, 0.05 * number]))
        found.append(ScenePose((performer_pose(number, turned, (0.0, 0.95, 0.02 * number)),)))
    return found


def state(character: Any) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (4,) of the left arm, and place (3,) of the hips relative to the object."""
    bpy.context.view_layer.update()
    posed = character.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    return np.array(posed["upper_arm.L"].matrix_basis.to_quaternion()), np.array(posed["hips"].matrix.translation)


def check(pair: tuple[Any, Any], number: int) -> None:
    """Both raise the arm alike; the smaller one makes steps in proportion to its legs."""
    (first_arm, first_place), (second_arm, second_place) = map(state, pair)
    assert abs(abs(first_arm @ second_arm) - 1.0) < 1e-5
    assert 2.0 * np.arccos(min(abs(first_arm[0]), 1.0)) == pytest.approx(0.05 * number, abs=1e-3)
    assert second_place[1] == pytest.approx(first_place[1] * 1.2 / 1.75, abs=0.01)
    assert first_place[1] == pytest.approx(-0.02 * number, abs=0.01)
    assert second_place[0] == pytest.approx(0.0, abs=0.01)  # it stays in its own place


def test_both_follow_live_and_get_actions(pair: tuple[Any, Any], play: Any) -> None:
    with closing(play(walk(SKELETON), ANNA)) as capture:
        for number in range(POSES):
            capture.tick(bpy.context)
            if number > 1:
                check(pair, len(capture.run.poses) - 1)
        text = capture.keep(bpy.context)
    assert f"in Capture, Capture {pair[1].name}: " in text
    for character in pair:
        assert len(key_times(curves_of(character))) == POSES - 1
    bpy.context.scene.frame_set(10)
    arms = [state(character)[0] for character in pair]
    assert abs(arms[0] @ arms[1]) > 1.0 - 1e-5


def test_a_take_is_put_on_both(part: Any, pair: tuple[Any, Any], tmp_path: Path) -> None:
    bpy.context.scene.perfanim_result.on_floor = False
    path = write_poses(tmp_path, "walk", [ANNA], walk(SKELETON))
    assert bpy.ops.perfanim.play_take(path=str(path)) == {"FINISHED"}
    assert part("jobs.activity").message("takes")[0].startswith(f"20 frames in walk, walk {pair[1].name} on ")
    bpy.context.scene.frame_set(11)
    check(pair, 10)


def test_a_character_that_was_deleted_or_chosen_twice_is_left_alone(
    part: Any, pair: tuple[Any, Any], targets: Any, tmp_path: Path
) -> None:
    problem = part("settings.target_settings").problem
    assert problem(bpy.context.scene) == ""
    first, second = pair
    targets.entries[0].armature = first
    assert "cannot follow two performers" in problem(bpy.context.scene)
    path = write_poses(tmp_path, "walk", [ANNA], walk(SKELETON))
    bpy.ops.perfanim.play_take(path=str(path))
    assert part("jobs.activity").message("takes")[0].startswith(f"20 frames in walk on {first.name}")
    targets.entries[0].armature = None
    assert "a further character is not chosen" in problem(bpy.context.scene)
    targets.entries[0].armature = second
    bpy.data.objects.remove(second)
    bpy.ops.perfanim.play_take(path=str(path))
    assert part("jobs.activity").message("takes")[0].startswith(f"20 frames in walk.001 on {first.name}")
