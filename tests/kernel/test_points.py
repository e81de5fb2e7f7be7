"""The filter of points, and their noise, by the kernel are NumPy's."""

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.geometry.multiple_model_filter import MotionModels, MultipleModelFilter, corrected, predicted
from perfanim.core.kernel.library import use_kernel
from perfanim.core.markers.marker_noise import differences, noise
from two_bodies import assert_same, spoiled

KIND = MotionModels((0.01e-3, 0.1e-3, 1e-3), least_sigma=0.2e-3, jump=0.05, first_speed=2.0, first_acceleration=20.0)
SPECIAL = [None, np.nan, np.inf, -np.inf, 1e300, 1e-300, 0.0]


def state(generator: np.random.Generator, points: int, models: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights and rows with covariances that are positive definite."""
    weights = generator.dirichlet(np.ones(models), size=points)
    factors = generator.normal(size=(points, models, 3, 3))
    covariances = factors @ factors.swapaxes(-1, -2)
    states = scale * generator.normal(size=(points, models, 9))
    return weights, np.concatenate((states, covariances.reshape(points, models, 9)), axis=-1)


@given(
    seed=st.integers(0, 2**32 - 1),
    points=st.sampled_from([0, 1, 8, 60]),
    models=st.sampled_from([2, 3, 5]),
    scale=st.sampled_from([1e-3, 1.0, 1e3]),
    elapsed_s=st.sampled_from([0.0, 1e-9, 1 / 60, 0.25]),
    special=st.sampled_from(SPECIAL),
    place=st.integers(0, 2000),
)
def test_any_prediction(seed: int, scale: float, special: float | None, place: int, **given: Any) -> None:
    generator, (points, models) = np.random.default_rng(seed), (given["points"], given["models"])
    kind = MotionModels(tuple(generator.uniform(1e-5, 1e-2, models)), 1e-3, 0.05, 2.0, 20.0)
    weights, rows = state(generator, points, models, scale)
    assert_same(predicted, weights, spoiled(rows, special, place), given["elapsed_s"], kind)
    assert_same(predicted, spoiled(weights, special, place), rows, given["elapsed_s"], kind)


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.sampled_from([0, 1, 8, 60]),
    near=st.sampled_from([1e-4, 0.05, 10.0]),
    special=st.sampled_from(SPECIAL),
    place=st.integers(0, 2000),
)
def test_any_correction(seed: int, count: int, near: float, special: float | None, place: int) -> None:
    generator = np.random.default_rng(seed)
    weights, rows = state(generator, count, 3, 1.0)
    points = rows[:, 0, :3] + near * generator.normal(size=(count, 3))
    points[generator.random(count) < 0.2] = np.nan
    followed, sigmas = generator.random(count) < 0.8, generator.uniform(1e-4, 1e-2, count)
    given = weights, rows, followed, points, sigmas
    for index in (0, 1, 3, 4):
        changed = [spoiled(each, special, place) if n == index else each for n, each in enumerate(given)]
        assert_same(corrected, *changed, KIND)


@given(
    seed=st.integers(0, 2**32 - 1),
    frames=st.sampled_from([0, 1, 3, 9, 10, 60, 241]),
    markers=st.sampled_from([0, 1, 9, 60]),
    hidden=st.sampled_from([0.0, 0.3, 0.97]),
    special=st.sampled_from(SPECIAL),
    place=st.integers(0, 2000),
)
def test_any_noise(seed: int, frames: int, markers: int, hidden: float, special: float | None, place: int) -> None:
    generator = np.random.default_rng(seed)
    rows = np.abs(generator.normal(size=(frames, markers)))
    rows[generator.random((frames, markers)) < hidden] = np.nan
    if frames > 1:
        rows[: frames // 2] = np.round(rows[: frames // 2], 1)  # ties
    assert_same(noise, spoiled(rows, special, place))
    times_s, points_m = np.cumsum(generator.uniform(0.002, 0.1, 5)), generator.normal(size=(5, markers, 3))
    assert_same(differences, times_s, spoiled(points_m, special, place))
    assert_same(differences, spoiled(times_s, special, place), points_m)


def test_whole_runs_are_the_same() -> None:
    generator = np.random.default_rng(0)
    points_m = np.cumsum(generator.normal(0.0, 0.004, (200, 6, 3)), axis=0)
    points_m[generator.random((200, 6)) < 0.1] = np.nan
    points_m[90:, 2] += 0.5
    runs = []
    for is_used in (False, True):
        assert use_kernel(is_used) == is_used
        follower, rows = MultipleModelFilter(KIND, 6), []
        for number, row in enumerate(points_m):
            follower.predict(number / 60.0)
            known = follower.observe(row, np.full(6, 1e-3))
            rows.append(np.column_stack((*follower.means(), follower.speeds(), known)))
        runs.append(np.array(rows))
    np.testing.assert_allclose(runs[1], runs[0], rtol=0.0, atol=1e-9)
    assert runs[0][:, :, -1].mean() > 0.8
