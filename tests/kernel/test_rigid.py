"""Rigid fits by the kernel are NumPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.rigid_transform import fit_rigid
from two_bodies import assert_same


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(3, 40),
    noise_m=st.sampled_from([0.0, 1e-9, 0.01, 0.1]),
    scale=st.sampled_from([1e-3, 1.0, 1e3]),
    with_weights=st.booleans(),
)
def test_any_points(seed: int, count: int, noise_m: float, scale: float, with_weights: bool) -> None:
    generator = np.random.default_rng(seed)
    source = scale * generator.normal(size=(count, 3))
    turned = rot.rotate(rot.from_rotation_vector(generator.normal(scale=2.0, size=3)), source)
    target = turned + scale * generator.normal(size=3) + scale * noise_m * generator.normal(size=source.shape)
    weights = generator.uniform(0.5, 4.0, size=count) if with_weights else None
    together = (source - source.mean(axis=0)).T @ (target - target.mean(axis=0))
    sizes = np.linalg.svd(together)[1]
    if sizes[1] < 1e-3 * sizes[0]:  # nearly on a line: rounding decides about the rotation
        return
    assert_same(fit_rigid, source, target, weights, rounding=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_half_turn_and_points_in_a_plane(sign):
    source = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-1.0, -1.0, 0.0], [3.0, 1.0, 0.0]])
    quaternion, translation = fit_rigid.compiled_body(source, source * [sign, sign, 1.0] + [5.0, 0.0, 0.0])
    found = rot.rotate(quaternion, source) + translation
    np.testing.assert_allclose(found, source * [sign, sign, 1.0] + [5.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((4, 3)), np.ones((1, 3)), np.arange(12.0).reshape(4, 3)])
def test_points_that_leave_the_rotation_open_are_fitted_by_some_rotation(points):
    quaternion, translation = fit_rigid.compiled_body(points, points + 1.0)
    assert abs(np.linalg.norm(quaternion) - 1.0) < 1e-12
    np.testing.assert_allclose(rot.rotate(quaternion, points) + translation, points + 1.0, atol=1e-9)


@pytest.mark.parametrize("special", [np.nan, np.inf, 1e300])
def test_what_is_not_finite_is_refused(special):
    points = np.random.default_rng(0).normal(size=(5, 3))
    spoiled = points.copy()
    spoiled[2, 1] = special
    for source, target in ((spoiled, points), (points, spoiled)) if special != 1e300 else ((spoiled, spoiled),):
        with pytest.raises(np.linalg.LinAlgError, match="finite"):
            fit_rigid.compiled_body(source, target)
