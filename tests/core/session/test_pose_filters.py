"""Smoothing of poses as they come, and what is shown in place of solved poses."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.one_euro import PoseSmoother
from perfanim.core.body.scene_pose import PerformerPose, PropPose, ScenePose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import PointKind, load_marker_set
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.markers.subject import Subject
from perfanim.core.session.pose_filters import FilterSettings, PoseFilter, filter_poses

FPS = 60
JOINTS = 29
PERFORMER = Subject("walker", default_skeleton(), load_marker_set("locomotion"))


def smoothed(delay_s: float, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles (F,) about x of all joints, and the root's way (F,) along x by as many metres, smoothed."""
    smoother = PoseSmoother(delay_s)
    found, way = [], []
    for number, angle in enumerate(angles):
        turn = rot.from_rotation_vector(np.tile([angle, 0.0, 0.0], (JOINTS, 1)))
        turns, root = smoother.step(number / FPS, turn, np.array([angle, 0.0, 0.0]))
        found.append(rot.to_rotation_vector(turns)[-1, 0])
        way.append(root[0])
    return np.array(found), np.array(way)


def test_jitter_is_smoothed() -> None:
    noise = 0.005 * np.random.default_rng(3).standard_normal(600)  # 0.3 degrees, 5 mm
    shaken = np.std(np.diff(noise, 3))
    calmer = [np.std(np.diff(smoothed(delay_s, noise)[0][60:], 3)) / shaken for delay_s in (0.02, 0.05, 0.1)]
    # a low-pass of first order lets through alpha / (2 - alpha) of white noise and less of its differences
    for share, delay_s in zip(calmer, (0.02, 0.05, 0.1), strict=True):
        alpha = 1.0 - np.exp(-1.0 / (FPS * delay_s) - 2.0 * np.pi * 0.5 / FPS)  # noise alone looks like some speed
        assert share < np.sqrt(alpha / (2.0 - alpha))
    assert calmer == sorted(calmer, reverse=True)


@pytest.mark.parametrize("delay_s", [0.02, 0.1])
def test_delay_is_full_for_slow_motion_and_less_for_fast_motion(delay_s: float) -> None:
    lags = []
    for speed, frames in ((0.01, 240), (3.0, 60)):  # no angle beyond half a turn
        seconds = np.arange(frames) / FPS
        turned, moved = smoothed(delay_s, speed * seconds)
        lags.append(seconds[-1] - np.array((turned[-1], moved[-1])) / speed)
    # a low-pass of first order at 60 steps a second; the slow motion's own speed raises its cutoff by 2.5 % at most
    assert lags[0] == pytest.approx(np.full(2, 1.0 / FPS / np.expm1(1.0 / FPS / delay_s)), rel=0.03)
    assert np.all(lags[0] <= delay_s)
    assert np.all(lags[1] < 0.7 * lags[0])


def test_filter_restarts_after_a_gap() -> None:
    smoother = PoseSmoother(0.1)
    still, turned = rot.identity((JOINTS,)), rot.from_rotation_vector(np.full((JOINTS, 3), 0.5))
    smoother.step(0.0, still, np.zeros(3))
    first, _ = smoother.step(1 / FPS, turned, np.ones(3))
    assert rot.angle_between(first, turned).max() > 0.1
    again, root = smoother.step(1.0, turned, np.ones(3))
    np.testing.assert_array_equal(again, turned)
    np.testing.assert_array_equal(root, np.ones(3))


def a_pose(number: int) -> ScenePose:
    angle = 0.05 * (number % 2)
    nowhere, none = np.empty((0, 3)), np.empty(0, dtype=np.int64)
    turns = rot.from_rotation_vector(np.tile([angle, 0.0, 0.0], (JOINTS, 1)))
    return ScenePose((PerformerPose(number, number / FPS, turns, np.zeros(3), 0.5, nowhere, nowhere, none, 0.0),))


def test_poses_pass_unchanged_without_filters() -> None:
    shaper = PoseFilter([PERFORMER], 0.0, FilterSettings())
    assert all(shaper.step(pose) is pose for pose in map(a_pose, range(5)))
    shaper.set_settings(FilterSettings.of_table({"smoothing_s": 0.05}))
    shown = [shaper.step(a_pose(number)) for number in range(5, 30)]
    raw = [a_pose(number) for number in range(5, 30)]
    swings = [
        np.ptp([rot.to_rotation_vector(pose.performers[0].rotations)[-1, 0] for pose in poses[5:]])
        for poses in (shown, raw)
    ]
    assert swings[0] < 0.7 * swings[1]
    assert [pose.number for pose in shown] == [pose.number for pose in raw]
    shaper.set_settings(FilterSettings())
    pose = a_pose(30)
    assert shaper.step(pose) is pose
    smooth = FilterSettings(smoothing_s=0.05)
    again = [shaper.step(a_pose(number)) for shaper in [PoseFilter([PERFORMER], 0.0, smooth)] for number in range(9)]
    for mine, other in zip(filter_poses(list(map(a_pose, range(9))), [PERFORMER], 0.0, smooth), again, strict=True):
        np.testing.assert_array_equal(mine.performers[0].rotations, other.performers[0].rotations)
    with pytest.raises(SettingsError, match="is not a mode"):
        shaper.set_settings(FilterSettings(feet="sometimes"))


def test_held_prop_has_the_delay_of_the_hand() -> None:
    """A prop that moves as the root does is smoothed as the root is; while it is hidden it stays as it is."""
    shaper = PoseFilter([PERFORMER], None, FilterSettings(smoothing_s=0.1))
    for number in range(40):
        way = np.array([0.2 * number / FPS, 0.0, 0.0])
        turn = rot.from_rotation_vector([0.5 * number / FPS, 0.0, 0.0])
        prop = PropPose(turn, way, 0.001, 0 if number in (20, 21) else 4)
        body = replace(a_pose(number).performers[0], root_position_m=way, rotations=np.tile(turn, (JOINTS, 1)))
        scene = shaper.step(ScenePose((body,), (prop,)))
        (shown,), (held,) = scene.performers, scene.props
        if number < 20:
            np.testing.assert_allclose(held.position_m, shown.root_position_m, atol=1e-12)
            np.testing.assert_allclose(held.rotation, shown.rotations[0], atol=1e-12)
            assert number == 0 or held.position_m[0] < way[0]
        elif number < 22:
            assert held is prop


def test_feet_are_held_against_the_errors_of_their_source() -> None:
    """A standing body that seems to sway, as by a network's lasting errors, keeps its feet in place."""
    sway_m, sway_hz, seconds = np.sqrt(2.0) * noise_of(PointKind.KEYPOINTS).lasting_m, 3.0, np.arange(2 * FPS) / FPS
    turns, ways_m = standing(PERFORMER.skeleton), {}
    positions_m = forward_kinematics(PERFORMER.skeleton, turns, np.zeros(3))[0]
    roots_m = np.array([0.0, -positions_m[:, 1].min(), 0.0]) + np.outer(
        sway_m * np.sin(2.0 * np.pi * sway_hz * seconds), [1.0, 0.0, 0.0]
    )
    poses = [
        ScenePose((replace(a_pose(number).performers[0], rotations=turns, root_position_m=root_m),))
        for number, root_m in enumerate(roots_m)
    ]
    for points in PointKind:
        performer = replace(PERFORMER, marker_set=replace(PERFORMER.marker_set, points=points))
        held = np.array([
            shown.performers[0].rotations
            for shown in filter_poses(poses, [performer], 0.0, FilterSettings(feet="auto"))
        ])  # fmt: skip
        balls_m = forward_kinematics(PERFORMER.skeleton, held, roots_m)[0][FPS:, PERFORMER.skeleton.index("ltoes")]
        ways_m[points] = np.ptp(balls_m[:, 0])
    assert ways_m[PointKind.KEYPOINTS] < 0.01 * sway_m < 0.2 * sway_m < ways_m[PointKind.MARKERS]
