"""Gaussians of poses by the kernel are NumPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.geometry import rotations as rot
from perfanim.core.solver.gaussian_conditioning import Prior, continue_prior
from perfanim.core.solver.motion_prior import moved_gaussians
from perfanim.core.solver.neighbours_prior import Neighbours, neighbours_prior
from two_bodies import assert_alike, assert_same, spoiled

EPSILON = float(np.finfo(np.float32).eps)
SPECIAL = st.sampled_from([None, np.nan, np.inf, -np.inf, 1e200, -1e200, 1e-310])


def covariance_of(generator: np.random.Generator, size: int) -> np.ndarray:
    factor = generator.normal(size=(size, size))
    return factor @ factor.T


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.sampled_from([1, 2, 30, 300]),
    sizes=st.sampled_from([(3, 0, 0), (1, 3, 1), (30, 9, 7), (84, 54, 60)]),
    scale=st.sampled_from([1e-20, 1e-4, 1.0, 10.0]),
    hidden=st.sampled_from([0.0, 0.3, 1.0]),
    special=st.sampled_from([None, np.nan, np.inf, -np.inf, 1e30, 1e-40]),
    spoils=st.integers(0, 7),
)
def test_any_neighbours_prior(
    seed: int,
    count: int,
    sizes: tuple[int, int, int],
    scale: float,
    hidden: float,
    special: float | None,
    spoils: int,
) -> None:
    generator = np.random.default_rng(seed)
    parts = [(scale * generator.normal(size=(count, size))).astype(np.float32) for size in sizes]
    arrays = [generator.uniform(size=count), *parts]
    past = scale * generator.normal(size=sum(sizes[1:]))
    past[generator.uniform(size=len(past)) < hidden] = np.nan
    arrays += [past, generator.uniform(0.01, 1.0, size=len(past)), np.eye(sum(sizes), dtype=np.float32)]
    if spoils < len(arrays):
        place = seed % sum(sizes) * (sum(sizes) + 1) if spoils == 6 else seed  # covariances stay symmetric
        arrays[spoils] = spoiled(arrays[spoils], special, place)
    inputs = Neighbours(*arrays[:4]), 0.3, *arrays[4:]
    # weights of far neighbours are small, but many
    assert_alike(neighbours_prior, *inputs, rounding=8.0 * count * EPSILON * max(1.0, scale * scale))


@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1, 3, 4, 84]), special=SPECIAL, spoils=st.integers(0, 3))
def test_any_continued_prior(seed: int, size: int, special: float | None, spoils: int) -> None:
    generator = np.random.default_rng(seed)
    covariances = [covariance_of(generator, size) + np.eye(size) for _ in range(2)]
    inputs = [generator.normal(size=size), covariances[0], generator.normal(size=size), covariances[1]]
    place = seed % size * (size + 1) if spoils % 2 else seed  # covariances stay symmetric
    inputs[spoils] = spoiled(inputs[spoils], special, place)
    largest = max([1.0, *(np.abs(each[np.isfinite(each)]).max(initial=0.0) for each in inputs)])
    assert_alike(continue_prior, Prior(*inputs[:2]), *inputs[2:], rounding=1e-9 * largest)  # a difference of such


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.sampled_from([0, 1, 3]),
    joints=st.sampled_from([1, 2, 28]),
    scale=st.sampled_from([0.0, 1e-12, 0.3, 3.0, 100.0]),
    special=SPECIAL,
)
def test_any_moved_gaussians(seed: int, count: int, joints: int, scale: float, special: float | None) -> None:
    generator = np.random.default_rng(seed)
    means = spoiled(scale * generator.normal(size=(count, 3 * joints)), special, seed)
    sigmas = generator.uniform(0.01, 1.0, size=means.shape)
    turn, before = rot.from_rotation_vector(generator.normal(scale=0.5, size=(2, joints, 3)))
    change = rot.multiply(rot.multiply(before[:, None], np.eye(4)), turn[:, None]).swapaxes(-1, -2)
    correlation = covariance_of(generator, 3 * joints)
    back = rot.to_matrix(rot.conjugate(turn))
    vectors = means.reshape(count, joints, 3)
    with np.errstate(all="ignore"):
        angles = rot.lengths(rot.to_rotation_vector((change @ rot.from_rotation_vector(vectors)[..., None])[..., 0]))
    if np.any(np.abs(angles - np.pi) < 1e-6):  # half a turn: rounding decides about the vector's direction
        return
    try:
        assert_same(moved_gaussians, means, sigmas, change, back, correlation, rounding=1e-9)
    except np.linalg.LinAlgError:  # NumPy refuses a matrix that the special value made singular
        assert special is not None


@pytest.mark.parametrize("angle", [0.0, 1e-200, 1e-9, np.pi - 1e-3, np.pi + 1e-3, 2.0 * np.pi - 1e-3, 7.0])
def test_rotations_by_special_angles(angle):
    means, ones = np.array([[0.0, angle, 0.0], [0.1, angle, 0.1]]), np.ones((2, 3))
    change = rot.multiply(rot.identity((1, 1)), np.eye(4)).swapaxes(-1, -2)
    assert_same(moved_gaussians, means, ones, change, np.eye(3)[None], np.eye(3))
