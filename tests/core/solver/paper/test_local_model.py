import numpy as np
import pytest
from perfanim.core.solver.paper.local_model import cross_validate, fit


@pytest.mark.parametrize(("count", "size"), [(20, 84), (84, 84), (200, 84), (5, 3)])
def test_fit_is_principal_component_analysis(count, size):
    poses = np.random.default_rng(0).normal(size=(count, size)) * np.linspace(2.0, 0.1, size)
    model = fit(poses, 6)
    centred = poses - poses.mean(axis=0)
    _, sizes, axes = np.linalg.svd(centred, full_matrices=False)
    kept = min(6, count - 1, size)
    assert (model.dimensions, model.neighbours) == (kept, count)
    np.testing.assert_allclose(model.mean, poses.mean(axis=0))
    np.testing.assert_allclose(model.variances, sizes[:kept] ** 2 / (count - 1), rtol=1e-9)
    np.testing.assert_allclose(model.basis.T @ model.basis, np.eye(kept), atol=1e-9)
    # same directions up to their signs
    np.testing.assert_allclose(np.abs(np.sum(model.basis * axes[:kept].T, axis=0)), 1.0, atol=1e-8)


def test_poses_and_weights():
    poses = np.random.default_rng(1).normal(size=(30, 10))
    model = fit(poses, 4)
    weights = np.array([0.3, -1.0, 0.0, 2.0])
    np.testing.assert_allclose(model.weights(model.pose(weights)), weights, atol=1e-12)
    full = fit(poses, 10)
    np.testing.assert_allclose(full.pose(full.weights(poses[3])), poses[3], atol=1e-9)


def test_model_of_equal_poses_has_a_variance_floor():
    model = fit(np.ones((12, 5)), 3)
    assert np.isfinite(model.pose(np.zeros(model.dimensions))).all()
    assert np.all(model.variances > 0.0)


def low_dimensional(known, seed, clips=20, frames=10, noise=0.02):
    """Clips of poses (84) in `known` directions, with noise in all others, and the markers (24) they show."""
    generator = np.random.default_rng(seed)
    directions = np.linalg.qr(generator.normal(size=(84, known)))[0]
    # frames of one clip are near copies
    weights = np.repeat(generator.normal(size=(clips, known)), frames, axis=0)
    weights += generator.normal(scale=0.05, size=weights.shape)
    poses = weights @ directions.T + generator.normal(scale=noise, size=(clips * frames, 84))
    markers = poses @ (generator.normal(size=(84, 24)) * 0.1)
    order = generator.permutation(clips * frames)
    return poses[order], markers[order], np.repeat(np.arange(clips), frames)[order]


@pytest.mark.parametrize("known", [3, 6, 12])
def test_cross_validation_finds_the_known_dimension(known):
    candidates = (3, 6, 12, 24)
    found = []
    for seed in range(5):
        poses, markers, groups = low_dimensional(known, seed)
        result = cross_validate(poses, markers, groups, (200,), candidates, 0.003**2, 60)
        found.append(result.model.dimensions)
        assert result.scores.shape == (1, 4)
        # fewer directions than there are leave out what moves
        fewer = result.scores[0, : candidates.index(known)]
        assert np.all(fewer > 1.5 * result.scores[0, candidates.index(known)])
    assert np.median(found) == known


def test_cross_validation_leaves_out_whole_clips():
    """With the clips known, the score tells the error on a new clip; with every frame its own clip it flatters."""
    poses, markers, groups = low_dimensional(12, 0, clips=8, frames=25)
    honest = cross_validate(poses, markers, groups, (200,), (12,), 0.003**2, 200)
    flattering = cross_validate(poses, markers, np.arange(200), (200,), (12,), 0.003**2, 200)
    assert flattering.scores[0, 0] < 0.5 * honest.scores[0, 0]


def test_one_clip_alone_takes_the_largest_model():
    poses, markers, _ = low_dimensional(3, 0)
    result = cross_validate(poses, markers, np.zeros(200, dtype=int), (30, 60), (3, 7), 1e-5, 20)
    assert np.all(np.isinf(result.scores))
    assert (result.model.neighbours, result.model.dimensions) == (60, 7)


def test_few_neighbours_are_all_taken():
    poses, markers, groups = low_dimensional(3, 0)
    result = cross_validate(poses[:12], markers[:12], groups[:12], (30, 60), (3, 7, 25), 1e-5, 10)
    assert result.model.neighbours == 12
    assert result.model.dimensions <= 11


def test_model_without_markers():
    poses, _, groups = low_dimensional(3, 0)
    result = cross_validate(poses, np.empty((200, 0)), groups, (60,), (3, 7), 1e-5, 20)
    assert np.isfinite(result.scores).all()
