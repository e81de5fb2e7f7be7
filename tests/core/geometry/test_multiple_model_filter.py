from copy import deepcopy

import numpy as np
from perfanim.core.geometry.multiple_model_filter import MotionModels, MultipleModelFilter

SLOW = MotionModels((0.01, 1.0), 0.1, 50.0, 2000.0, 20000.0)
QUICK = MotionModels((1.0, 100.0), 0.1, 0.5, 2000.0, 20000.0)
FRAME_S, NOISE = 1.0 / 60.0, 3.0


def test_noise_is_reduced_most_where_little_change_is_expected() -> None:
    points = np.zeros((120, 2, 3))
    points[:, 1, 0] = 2.0 * np.arange(120)
    seen = points + np.random.default_rng(1).normal(0.0, NOISE, points.shape)
    errors = []
    for models in (SLOW, QUICK):
        follower, found = MultipleModelFilter(models, 2), []
        for frame, row in enumerate(seen):
            follower.predict(frame * FRAME_S)
            follower.observe(row, np.full(2, NOISE))
            found.append(follower.means()[0])
        errors.append(np.linalg.norm(np.array(found) - points, axis=-1)[60:].mean(axis=0))
    slow, quick = errors
    assert slow.max() < 0.85 * quick.min()
    assert quick.max() < NOISE * np.sqrt(3.0)


def test_unseen_points_go_on_and_jumping_points_start_over() -> None:
    follower = MultipleModelFilter(SLOW, 1)
    for frame in range(60):
        follower.predict(frame * FRAME_S)
        continued = follower.observe(np.array([[frame, 0.0, 0.0]]), np.zeros(1))
    assert continued.all()
    follower.predict(60 * FRAME_S)
    assert not follower.observe(np.full((1, 3), np.nan), np.zeros(1)).any()
    np.testing.assert_allclose(follower.means()[0], [[60.0, 0.0, 0.0]], atol=0.1)
    follower.predict(61 * FRAME_S)
    assert not follower.observe(np.array([[300.0, 0.0, 0.0]]), np.zeros(1)).any()
    np.testing.assert_allclose(follower.means()[0], [[300.0, 0.0, 0.0]])


def test_precision_does_not_depend_on_the_origin() -> None:
    found = []
    for away in (0.0, 1e8):
        chance, follower = np.random.default_rng(1), MultipleModelFilter(SLOW, 1)
        for frame in range(60):
            follower.predict(frame * FRAME_S)
            follower.observe(chance.normal(away, NOISE, (1, 3)), np.full(1, NOISE))
        found.append(follower.means())
    np.testing.assert_allclose(found[1][0] - 1e8, found[0][0], atol=1e-5)
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-6)


def test_a_copy_goes_on_as_the_filter_would() -> None:
    rows = np.random.default_rng(5).normal(0.0, 100.0, (40, 3, 3)).cumsum(axis=0)
    follower = MultipleModelFilter(QUICK, 3)
    for frame, row in enumerate(rows[:20]):
        follower.predict(frame * FRAME_S)
        follower.observe(row, np.full(3, NOISE))
    followers = follower, deepcopy(follower)
    for each in followers:
        for frame, row in enumerate(rows[20:], 20):
            each.predict(frame * FRAME_S)
            each.observe(row, np.full(3, NOISE))
    np.testing.assert_array_equal(followers[0].means()[0], followers[1].means()[0])
