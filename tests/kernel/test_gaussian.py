"""Gaussians of poses by the kernel are NumPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.geometry import rotations as rot
from perfanim.core.solver.gaussian_conditioning import neighbours_prior, observed_covariance, weighted_spread
from perfanim.core.solver.motion_prior import moved_gaussian
from two_bodies import assert_same, spoiled

EPSILON = float(np.finfo(np.float32).eps)
SPECIAL = st.sampled_from([None, np.nan, np.inf, -np.inf, 1e200, -1e200, 1e-310])


def covariance_of(generator: np.random.Generator, size: int) -> np.ndarray:
    factor = generator.normal(size=(size, size))
    return factor @ factor.T


@given(
    seed=st.integers(0, 2**32 - 1), rows=st.sampled_from([0, 1, 2, 27, 60]), special=SPECIAL, spoils=st.integers(0, 2)
)
def test_any_observed_covariance(seed: int, rows: int, special: float | None, spoils: int) -> None:
    generator = np.random.default_rng(seed)
    size = 3 * int(generator.integers(1, 40))
    jacobian = generator.normal(size=(rows, 6 + size)) * (generator.uniform(size=(rows, 6 + size)) < 0.5)
    inputs = [jacobian, generator.uniform(size=6), covariance_of(generator, size)]
    place = seed % size * (size + 1) if spoils == 2 else seed  # covariances stay symmetric
    inputs[spoils] = spoiled(inputs[spoils], special, place)
    assert_same(observed_covariance, *inputs)
    assert_same(observed_covariance, inputs[0], inputs[1], np.asfortranarray(inputs[2]))


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.sampled_from([1, 2, 30, 300]),
    size=st.sampled_from([1, 7, 8, 198]),
    scale=st.sampled_from([1e-20, 1e-4, 1.0, 1e4]),
    special=st.sampled_from([None, np.nan, np.inf, 1e30, 1e-40]),
)
def test_any_weighted_spread(seed: int, count: int, size: int, scale: float, special: float | None) -> None:
    generator = np.random.default_rng(seed)
    samples = spoiled((scale * generator.normal(size=(count, size))).astype(np.float32), special, seed)
    weights = generator.uniform(size=count)
    assert_same(weighted_spread, samples, weights / weights.sum(), rounding=2.0 * count * EPSILON)


def test_samples_of_double_precision_are_left_to_numpy():
    generator = np.random.default_rng(0)
    samples, weights = generator.normal(size=(30, 5)), np.full(30, 1.0 / 30.0)
    assert_same(weighted_spread, samples, weights, rounding=0.0)
    prior = neighbours_prior(samples, weights, np.eye(5), np.zeros(2), np.ones(2))
    assert prior.covariance.shape == (3, 3)


@given(
    seed=st.integers(0, 2**32 - 1),
    joints=st.sampled_from([1, 2, 28]),
    scale=st.sampled_from([0.0, 1e-12, 0.3, 3.0, 100.0]),
    special=SPECIAL,
)
def test_any_moved_gaussian(seed: int, joints: int, scale: float, special: float | None) -> None:
    generator = np.random.default_rng(seed)
    mean = spoiled(scale * generator.normal(size=3 * joints), special, seed)
    sigmas = generator.uniform(0.01, 1.0, size=3 * joints)
    turn, before = rot.from_rotation_vector(generator.normal(scale=0.5, size=(2, joints, 3)))
    change = rot.multiply(rot.multiply(before[:, None], np.eye(4)), turn[:, None]).swapaxes(-1, -2)
    correlation = covariance_of(generator, 3 * joints)
    back = rot.to_matrix(rot.conjugate(turn))
    vectors = mean.reshape(-1, 3)
    with np.errstate(all="ignore"):
        angles = rot.lengths(rot.to_rotation_vector((change @ rot.from_rotation_vector(vectors)[..., None])[..., 0]))
    if np.any(np.abs(angles - np.pi) < 1e-6):  # half a turn: rounding decides about the vector's direction
        return
    try:
        assert_same(moved_gaussian, mean, sigmas, change, back, correlation, rounding=1e-9)
    except np.linalg.LinAlgError:  # NumPy refuses a matrix that the special value made singular
        assert special is not None


@pytest.mark.parametrize("angle", [0.0, 1e-200, 1e-9, np.pi - 1e-3, np.pi + 1e-3, 2.0 * np.pi - 1e-3, 7.0])
def test_rotations_by_special_angles(angle):
    mean, one = np.array([0.0, angle, 0.0]), np.ones(3)
    change = rot.multiply(rot.identity((1, 1)), np.eye(4)).swapaxes(-1, -2)
    assert_same(moved_gaussian, mean, one, change, np.eye(3)[None], np.eye(3))
