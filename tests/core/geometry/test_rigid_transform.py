import numpy as np
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.rigid_transform import kabsch, transform


def cloud(seed: int, count: int = 6) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3))


def test_exact_transform_is_found() -> None:
    for seed in range(20):
        points = cloud(seed, 3 + seed % 5)
        matrix = rot.to_matrix(rot.from_rotation_vector(3.0 * cloud(seed + 100)[0]))
        shift = cloud(seed + 200)[0]
        found, translation = kabsch(points, transform(matrix, shift, points))
        np.testing.assert_allclose(found, matrix, atol=1e-10)
        np.testing.assert_allclose(translation, shift, atol=1e-10)


def test_mirrored_points_give_a_rotation() -> None:
    points = cloud(1)
    found, _ = kabsch(points, points * np.array([-1.0, 1.0, 1.0]))
    np.testing.assert_allclose(np.linalg.det(found), 1.0)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)


def test_fit_is_a_minimum() -> None:
    source, weights = cloud(2), np.array([1.0, 2.0, 0.5, 4.0, 1.0, 3.0])
    target = cloud(3) * 0.3 + source
    matrix, shift = kabsch(source, target, weights)

    def cost(turn: np.ndarray, move: np.ndarray) -> float:
        return float(weights @ np.sum((target - transform(matrix @ turn, shift + move, source)) ** 2, axis=1))

    least = cost(np.eye(3), np.zeros(3))
    for step in cloud(4, 30) * 1e-3:
        assert cost(rot.to_matrix(rot.from_rotation_vector(step)), np.zeros(3)) >= least
        assert cost(np.eye(3), step) >= least


def test_points_without_weight_do_not_count() -> None:
    source = cloud(5)
    target = transform(np.eye(3), [1.0, 2.0, 3.0], source)
    target[0] += 10.0
    matrix, shift = kabsch(source, target, [0.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(matrix, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(shift, [1.0, 2.0, 3.0])
