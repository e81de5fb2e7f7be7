"""The models of Figure 5 on poses whose dimension is known."""

import numpy as np
from bench.figure5 import linear, mixture

DIMENSIONS = (1, 2, 4, 8)


def planes(generator, count=300):
    """Two planes of two dimensions each in a space of ten, far apart."""
    parts = []
    for centre in (0.0, 5.0):
        basis = np.linalg.qr(generator.normal(size=(10, 2)))[0]
        parts.append(centre + generator.normal(size=(count, 2)) @ basis.T)
    return np.concatenate(parts)


def errors(found, truth):
    return np.sqrt(np.mean((found - truth) ** 2, axis=(1, 2)))


def test_linear_model_holds_what_lies_in_its_plane():
    poses = planes(np.random.default_rng(0))[:300]
    found = errors(linear(poses, poses, DIMENSIONS), poses)
    assert found[0] > 0.1
    np.testing.assert_allclose(found[1:], 0.0, atol=1e-9)


def test_mixture_holds_several_planes_where_one_plane_does_not():
    poses = planes(np.random.default_rng(1))
    one, many = (errors(model(poses, poses, DIMENSIONS), poses) for model in (linear, mixture))
    assert one[1] > 0.1
    assert many[0] < one[0]
    np.testing.assert_allclose(many[1:], 0.0, atol=1e-9)


def test_mixture_takes_repeated_poses():
    poses = np.repeat(np.eye(3), 300, axis=0)
    np.testing.assert_allclose(mixture(poses, poses, (2,))[0], poses, atol=1e-9)
