"""Earlier markers and poses: the database's against forward kinematics in the world, the others against what was."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.skeleton import marker_positions
from perfanim.core.geometry import rotations as rot
from perfanim.core.solver.database_markers import database_markers
from perfanim.core.solver.lagged_history import LaggedFrames, LaggedHistory, LaggedMarkers, LaggedPoses
from perfanim.core.solver.subject_model import RootPose

LAGS_S = (0.1, 0.25)
MATRICES = 2 * 3 * 0.5 / 32_760  # metres that rounded entries of two matrices move a point 1 m away, at most


@pytest.fixture
def markers(model, database):
    return LaggedMarkers(database, database_markers(model, database), LaggedFrames(database, LAGS_S))


def test_earlier_markers_are_in_the_current_root_frame(markers, model, database):
    clip = database.clips[1]
    lags, unit_m = [round(lag * database.fps) for lag in LAGS_S], database_markers(model, database).unit_m
    assert unit_m < 1e-4
    frames = np.array([clip.start, clip.start + lags[0], clip.start + 40])
    found = markers.of_frames(frames)
    for row, frame in zip(found, frames, strict=True):
        root = RootPose(database.root_rotations[frame].astype(float), database.root_positions_m[frame].astype(float))
        for found_m, lag in zip(row, lags, strict=True):
            earlier = max(frame - lag, clip.start)
            world = marker_positions(
                model.skeleton, model.joints, model.offsets_m, database.local_rotations(earlier),
                database.root_positions_m[earlier],
            )  # fmt: skip
            np.testing.assert_allclose(
                found_m, root.to_root_frame(world), atol=unit_m + MATRICES
            )  # each coordinate within a half


def test_nearly_unit_quaternions_are_normalised(model, database):
    """The database's own check lets lengths differ by a thousandth: entries of their matrices would not fit."""
    nearly = np.tile(np.array([0.0, 1.0009, 0.0, 0.0], dtype=np.float32), (database.frames, 1))
    markers = LaggedMarkers(
        replace(database, root_rotations=nearly), database_markers(model, database), LaggedFrames(database, LAGS_S)
    )
    stored = markers._root_matrices[:3].reshape(3, 3, 3) / 32_760
    np.testing.assert_allclose(stored, np.tile(np.diag([1.0, -1.0, -1.0]), (3, 1, 1)), atol=1e-4)


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_observed_markers_are_recalled_at_any_rate(markers, fps):
    """A body that moves steadily: where it was is known."""
    start, velocity = np.random.default_rng(0).normal(size=(2, 8, 3))
    times = np.arange(0.0, 1.0, 1.0 / fps)
    history = LaggedHistory(LAGS_S[-1])
    for time in times[:-1]:
        history = history.remember(time, start + velocity * time)
    root = RootPose(rot.from_rotation_vector([0.1, 1.0, -0.3]), np.array([0.4, 1.0, -2.0]))
    found = markers.observed(history, times[-1], root)
    half_frame = 0.5 / fps * np.abs(velocity) + 1e-9
    for found_m, lag in zip(found, LAGS_S, strict=True):
        assert np.all(np.abs(root.to_world(found_m) - start - velocity * (times[-1] - lag)) <= half_frame)


def test_unseen_markers_are_unknown(markers):
    history = LaggedHistory(LAGS_S[-1])
    root = RootPose(rot.identity(), np.zeros(3))
    assert np.isnan(markers.observed(history, 0.0, root)).all()
    points = np.ones((8, 3))
    points[2] = np.nan
    history = history.remember(0.0, points)
    now = markers.observed(history, 0.1, root)
    assert np.isnan(now[1]).all()  # nothing goes back a quarter of a second
    np.testing.assert_array_equal(now[0], points)
    assert np.isnan(markers.observed(history, 5.0, root)).all()
    history = history.remember(-5.0, points)  # a clock that is set back starts another recording
    assert np.isnan(markers.observed(history, 0.1, root)).all()


@pytest.fixture
def components():
    return np.linalg.qr(np.random.default_rng(1).normal(size=(84, 5)))[0]


@pytest.fixture
def lagged_poses(database, components):
    return LaggedPoses(database, components, LaggedFrames(database, LAGS_S))


def test_earlier_poses_are_from_the_same_clip(lagged_poses, database, components):
    clip = database.clips[1]
    lags = [round(lag * database.fps) for lag in LAGS_S]
    frames = np.array([clip.start, clip.start + lags[0], clip.start + 40])
    for row, frame in zip(lagged_poses.of_frames(frames), frames, strict=True):
        for found, lag in zip(row, lags, strict=True):
            pose = database.poses[max(frame - lag, clip.start)].ravel()
            np.testing.assert_allclose(found, pose @ components, atol=1e-5)  # stored in float32


def test_only_solved_poses_are_recalled(lagged_poses, components):
    history = LaggedHistory(LAGS_S[-1])
    poses = np.random.default_rng(2).normal(size=(3, 84))
    for time, pose in zip((0.0, 0.15, 0.25), poses, strict=True):
        history = history.remember(time, pose)
    np.testing.assert_allclose(
        lagged_poses.observed(history, 0.25), [poses[1] @ components, poses[0] @ components], atol=1e-5
    )
    now = lagged_poses.observed(history, 0.4)
    assert np.isnan(now[0]).all()  # 0.3 s is missing
    np.testing.assert_allclose(now[1], poses[1] @ components, atol=1e-5)
    history = LaggedHistory(LAGS_S[-1])
    assert np.isnan(lagged_poses.observed(history, 0.25)).all()
