"""Poses calmed by their neighbours in time."""

from dataclasses import replace

import numpy as np
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import PointKind
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.session.delayed_poses import DelayedPoses, calm_poses

JOINTS, FPS = 29, 60.0
MARKERS, KEYPOINTS = noise_of(PointKind.MARKERS), noise_of(PointKind.KEYPOINTS)


def poses_of(angles: np.ndarray, times_s: np.ndarray) -> list[ScenePose]:
    """Poses whose joints all have these angles (F,) about x, and whose root is as many metres along x."""
    nowhere, none = np.empty((0, 3)), np.empty(0, dtype=np.int64)
    found = []
    for number, (angle, time_s) in enumerate(zip(angles, times_s, strict=True)):
        turns = rot.from_rotation_vector(np.tile([angle, 0.0, 0.0], (JOINTS, 1)))
        root_m = np.array([angle, 0.0, 0.0])
        pose = PerformerPose(number, float(time_s), turns, root_m, 0.5, nowhere, nowhere, none, 0.0)
        found.append(ScenePose((pose,)))
    return found


def angles_of(poses: list[ScenePose]) -> np.ndarray:
    turned = [rot.to_rotation_vector(pose.performers[0].rotations)[-1, 0] for pose in poses]
    np.testing.assert_allclose(turned, [pose.performers[0].root_position_m[0] for pose in poses], atol=1e-9)
    return np.array(turned)


def test_steady_motion_is_unchanged_at_uneven_times() -> None:
    """The mean neither lags nor leads, whatever the steps."""
    times_s = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.07, 60))
    angles = 0.4 * times_s
    np.testing.assert_allclose(angles_of(calm_poses(poses_of(angles, times_s), MARKERS)), angles, atol=1e-9)


def test_weights_are_binomial_at_60_frames_a_second() -> None:
    """White noise keeps sqrt(70) / 16 of its deviation, and its third differences sqrt(28) / 16 / sqrt(20)."""
    noise = np.random.default_rng(1).normal(0.0, 0.01, 3000)
    found = angles_of(calm_poses(poses_of(noise, np.arange(3000) / FPS), MARKERS))
    kernel = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
    assert abs(np.std(found) / np.std(noise) / np.sqrt(kernel @ kernel) - 1.0) < 0.05
    assert np.std(np.diff(found, 3)) < 0.15 * np.std(np.diff(noise, 3))


def test_keypoints_at_30_frames_a_second_are_calmed_like_markers_at_60() -> None:
    """Their noise is larger; with the weights of markers their third differences would be three times as large."""
    noise = np.random.default_rng(1).normal(0.0, 0.01, 3000)
    markers, keypoints = (
        np.std(np.diff(angles_of(calm_poses(poses_of(noise, np.arange(3000) / 30.0), source)), 3))
        for source in (MARKERS, KEYPOINTS)
    )
    assert keypoints < 0.15 * np.std(np.diff(noise, 3)) < markers


def test_capture_gives_the_same_poses_two_frames_later() -> None:
    poses = poses_of(np.random.default_rng(2).normal(0.0, 0.1, 20), np.arange(20) / FPS)
    delayed = DelayedPoses(MARKERS)
    live = [delayed.step(pose) for pose in poses]
    assert live[:2] == [None, None]
    found = [pose for pose in live if pose is not None] + delayed.rest()
    assert [pose.number for pose in found] == list(range(20))
    assert [pose.time_s for pose in found] == [pose.time_s for pose in poses]
    np.testing.assert_array_equal(angles_of(found), angles_of(calm_poses(poses, MARKERS)))


def test_short_captures_keep_all_poses() -> None:
    for count in range(4):
        poses, delayed = poses_of(np.arange(count) / 10.0, np.arange(count) / FPS), DelayedPoses(MARKERS)
        found = [pose for pose in map(delayed.step, poses) if pose is not None] + delayed.rest()
        assert [pose.number for pose in found] == list(range(count))


def test_cuts_pauses_and_unsolved_poses_are_not_averaged_over() -> None:
    angles, times_s = np.where(np.arange(20) < 10, 0.0, 0.5), np.arange(20) / FPS
    np.testing.assert_array_equal(angles_of(calm_poses(poses_of(angles, times_s), MARKERS)), angles)
    small = 0.2 * angles
    paused_s = times_s + np.where(np.arange(20) < 10, 0.0, 0.5)
    np.testing.assert_array_equal(angles_of(calm_poses(poses_of(small, paused_s), MARKERS)), small)
    poses = poses_of(small, times_s)
    for number in range(10):
        unsolved = replace(poses[number].performers[0], marker_rms_m=float("nan"))
        poses[number] = replace(poses[number], performers=(unsolved,))
    np.testing.assert_allclose(angles_of(calm_poses(poses, MARKERS)), small, atol=1e-12)
