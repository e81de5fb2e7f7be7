"""The end of a capture and Put on Character write the same keyframes for the same take, at a steady rate."""

import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from perfanim.core.body.body_parts import PARTS
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.markers.prop import load_prop
from perfanim.core.markers.subject import Subject
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.core.system.assets import MOTION
from played import curves_of, key_times, played_poses, points_from_blender
from solved_poses import write_poses
from ticking import stop_and_keep, tick_until

from tests.helpers.irregular_takes import SKELETON, SUIT, hands_at, hands_m, random_series, scene_poses

pytestmark = pytest.mark.usefixtures("as_recorded")

NEAR_M = 0.005


def keys_of(armature: Any) -> dict[tuple[str, int], np.ndarray]:
    """Frame and value of each key of the action that an armature plays."""
    return {
        (curve.data_path, curve.array_index): np.array([key.co for key in curve.keyframe_points])
        for curve in curves_of(armature)
    }


def key_types_of(armature: Any) -> list[str]:
    """Type of each key of the first curve."""
    return [key.type for key in next(iter(curves_of(armature))).keyframe_points]


def test_put_on_character_writes_the_keys_of_the_capture(
    part: Any, chosen: Any, new_capture: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = bpy.context.scene
    build_database([str(MOTION / "walking-01-neutral.bvh")], tmp_path / "walk.pfdb", BuildSettings(fps=30.0))
    chosen.database, chosen.behaviour = str(tmp_path / "walk.pfdb"), "walking"
    # a countdown: the filters have run for a second before the first recorded pose
    chosen.smoothing_ms, chosen.feet, chosen.record_countdown_s, chosen.record_length_s = 80.0, "auto", 1, 0.5
    scene.perfanim_result.start = "FIRST"
    with closing(new_capture()) as capture:
        tick_until(capture, lambda: capture.recording is None and capture.run is not None)
        text = stop_and_keep(capture)
    assert "frames recorded in Capture" in text
    armature = chosen.armature
    live = keys_of(armature)
    (listed,) = part("take_library").listed()
    take = read_take_file(listed.path)
    assert len(take.recorded_poses) < len(take.poses)
    assert take.notes.filters == {"smoothing_s": 0.08, "feet": "auto"}
    chosen.smoothing_ms, chosen.feet = 0.0, "off"
    assert bpy.ops.perfanim.play_take(path=str(listed.path)) == {"FINISHED"}
    written = keys_of(armature)
    assert written.keys() == live.keys()
    for curve, keys in written.items():
        np.testing.assert_array_equal(keys, live[curve])
    scene.perfanim_result.filters = "CHOSEN"
    bpy.ops.perfanim.play_take(path=str(listed.path))
    unfiltered = keys_of(armature)
    assert any(not np.allclose(unfiltered[curve], keys, atol=1e-6) for curve, keys in live.items())
    # so that some of the poses are doubtful, but not the last
    confidence = [pose.performers[0].confidence for pose in take.recorded_poses]
    threshold = float(np.median(confidence[:-1]))
    monkeypatch.setattr(part("capture.write_take"), "DOUBTFUL", threshold)
    poses_module, never = sys.modules[part("capture.write_take").ScenePose.__module__], np.full(len(PARTS), np.inf)
    monkeypatch.setattr(poses_module, "DOUBTFUL_PART_DEG", never)  # of single parts below
    doubtful = [sure < threshold for sure in confidence]
    assert 0 < sum(doubtful) < len(doubtful)
    bpy.ops.perfanim.play_take(path=str(listed.path))
    assert key_types_of(armature) == ["JITTER" if doubt else "KEYFRAME" for doubt in doubtful]
    scene.perfanim_result.doubtful = "LEAVE_OUT"
    bpy.ops.perfanim.play_take(path=str(listed.path))
    kept = ~np.array(doubtful)
    kept[[0, -1]] = True
    for curve, keys in keys_of(armature).items():
        np.testing.assert_array_equal(keys, unfiltered[curve][kept])
    # the same for an arm alone: only its bones are marked
    arm, errors = list(PARTS).index("left arm"), [pose.performers[0].part_errors_deg for pose in take.recorded_poses]
    most = float(np.median([each[arm] for each in errors]))
    monkeypatch.setattr(part("capture.write_take"), "DOUBTFUL", 0.0)
    monkeypatch.setattr(poses_module, "DOUBTFUL_PART_DEG", np.where(np.arange(len(PARTS)) == arm, most, never))
    scene.perfanim_result.doubtful = "MARK"
    bpy.ops.perfanim.play_take(path=str(listed.path))
    for curve in curves_of(armature):
        of_arm = curve.group.name in [NAMINGS["blender"][joint] for joint in PARTS["left arm"]]
        types = ["JITTER" if of_arm and each[arm] > most else "KEYFRAME" for each in errors]
        assert [key.type for key in curve.keyframe_points] == types, curve.group.name


@pytest.mark.parametrize("seeds", [range(10), pytest.param(range(10, 50), marks=pytest.mark.long)])
def test_keys_of_frames_at_random_times_are_steady_and_the_hand_is_where_it_was(
    part: Any, chosen: Any, targets: Any, tmp_path: Path, seeds: range
) -> None:
    scene, waver, sword = bpy.context.scene, Subject("waver", SKELETON, SUIT), load_prop("sword")
    targets.entries.add()
    chosen.feet, scene.perfanim_result.filters, scene.perfanim_result.start = "off", "CHOSEN", "FIRST"
    for seed in seeds:
        series = random_series(seed)
        path = write_poses(tmp_path, f"take {seed}", [waver], scene_poses(series), [sword])
        assert bpy.ops.perfanim.play_take(path=str(path)) == {"FINISHED"}
        armature, held = chosen.armature, targets.entries[0].object
        passed_s, keys = np.ptp(series.true_s), key_times(curves_of(armature))
        assert np.ptp(np.diff(keys)) < 1e-3, seed
        assert abs((keys[-1] - keys[0]) / scene.render.fps - passed_s) < np.diff(keys)[0] / scene.render.fps + 0.001
        shown = np.arange(1.0, keys[-1], 7.0)
        true_m = hands_at(series.true_s[0] + (shown - 1.0) / scene.render.fps)
        played_m = hands_m(*played_poses(armature.name, shown, SKELETON))
        assert np.linalg.norm(played_m - true_m, axis=1).max() < NEAR_M, seed
        held_m = points_from_blender(places_of(held, shown) - np.array(armature.location))
        assert np.linalg.norm(held_m - true_m, axis=1).max() < NEAR_M, seed


def places_of(target: Any, frames: np.ndarray) -> np.ndarray:
    """Return an object's position (F, 3) in scene frames."""
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(int(frame), subframe=float(frame % 1.0))
        found.append(target.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world.translation.copy())
    return np.array(found)
