"""Earlier markers: those of the database against forward kinematics in the world, those seen against what was seen."""

import numpy as np
import pytest
from perfanim.core import rotations as rot
from perfanim.core.skeleton import marker_positions
from perfanim.core.solver.history import MarkerHistory
from perfanim.core.solver.subject_model import RootPose

LAGS_S = (0.1, 0.25)


@pytest.fixture
def history(model, database):
    return MarkerHistory(database, model.database_markers(database), LAGS_S)


def test_earlier_markers_of_a_frame_are_those_of_its_clip_seen_from_its_root(history, model, database):
    clip = database.clips[1]
    lags = [round(lag * database.fps) for lag in LAGS_S]
    frames = np.array([clip.start, clip.start + lags[0], clip.start + 40])
    found = history.of_frames(frames)
    for row, frame in zip(found, frames, strict=True):
        root = RootPose(database.root_rotations[frame].astype(float), database.root_positions_m[frame].astype(float))
        for markers, lag in zip(row, lags, strict=True):
            earlier = max(frame - lag, clip.start)
            world = marker_positions(
                model.skeleton, model.joints, model.offsets_m, database.local_rotations(earlier),
                database.root_positions_m[earlier],
            )  # fmt: skip
            np.testing.assert_allclose(markers, root.to_root_frame(world), atol=1e-5)  # stored in float32


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_markers_seen_are_found_again_whatever_the_rate(history, fps):
    """A body that moves steadily: where it was is known."""
    start, velocity = np.random.default_rng(0).normal(size=(2, 8, 3))
    times = np.arange(0.0, 1.0, 1.0 / fps)
    for time in times[:-1]:
        history.remember(time, start + velocity * time)
    root = RootPose(rot.from_rotation_vector([0.1, 1.0, -0.3]), np.array([0.4, 1.0, -2.0]))
    found = history.observed(times[-1], root)
    half_frame = 0.5 / fps * np.abs(velocity) + 1e-9
    for markers, lag in zip(found, LAGS_S, strict=True):
        assert np.all(np.abs(root.to_world(markers) - start - velocity * (times[-1] - lag)) <= half_frame)


def test_what_was_not_seen_is_unknown(history):
    root = RootPose(rot.identity(), np.zeros(3))
    assert np.isnan(history.observed(0.0, root)).all()
    points = np.ones((8, 3))
    points[2] = np.nan
    history.remember(0.0, points)
    now = history.observed(0.1, root)
    assert np.isnan(now[1]).all()  # nothing goes back a quarter of a second
    np.testing.assert_array_equal(now[0], points)
    assert np.isnan(history.observed(5.0, root)).all()
    history.remember(-5.0, points)  # a clock that is set back starts another recording
    assert np.isnan(history.observed(0.1, root)).all()
    history.reset()
    assert np.isnan(history.observed(0.1, root)).all()
