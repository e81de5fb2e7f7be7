import numpy as np
import pytest
from perfanim.core.geometry.principal_components import principal_components

POSES = 600


@pytest.mark.parametrize("count", [1, 3, 5])
def test_directions_of_the_largest_variance_come_first(count):
    generator = np.random.default_rng(0)
    directions, _ = np.linalg.qr(generator.normal(size=(5, 5)))
    spread = np.array([4.0, 2.0, 1.0, 0.5, 0.25])
    poses = 3.0 + (generator.normal(size=(POSES, 5)) * spread) @ directions.T
    found = principal_components(poses, count)
    assert found.shape == (5, count)
    np.testing.assert_allclose(found.T @ found, np.eye(count), atol=1e-12)
    # of 600 poses, each half as widely spread along the next, a direction is known to some hundredths
    np.testing.assert_allclose(np.abs(np.sum(found * directions[:, :count], axis=0)), 1.0, atol=0.01)
