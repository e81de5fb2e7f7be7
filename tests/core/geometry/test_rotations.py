import itertools

import numpy as np
import pytest
from perfanim.core.geometry import rotations as rot
from scipy.spatial.transform import Rotation

Array = np.ndarray
ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]


def random_rotations(count: int = 200, seed: int = 0) -> Array:
    """Rotations of all angles, some of them nearly none or nearly a half turn."""
    generator = np.random.default_rng(seed)
    axes = generator.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = generator.uniform(0.0, np.pi, count)
    angles[:6] = 0.0, 1e-12, 1e-7, 1e-4, np.pi - 1e-7, np.pi
    return rot.from_rotation_vector(axes * angles[:, None])


def scipy_of(q: Array) -> Rotation:
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def same(a: Array, b: Array) -> float:
    return float(np.max(rot.angle_between(a, b)))


def test_products_and_rotated_vectors_equal_scipys() -> None:
    a, b = random_rotations(), random_rotations(seed=1)
    v = np.random.default_rng(2).normal(size=(200, 3))
    assert same(rot.multiply(a, b), np.roll((scipy_of(a) * scipy_of(b)).as_quat(), 1, axis=-1)) < 1e-14 * 10
    np.testing.assert_allclose(rot.rotate(a, v), scipy_of(a).apply(v), atol=1e-14)
    np.testing.assert_allclose(rot.rotate(rot.multiply(a, b), v), rot.rotate(a, rot.rotate(b, v)), atol=1e-14)
    np.testing.assert_allclose(rot.rotate(rot.conjugate(a), rot.rotate(a, v)), v, atol=1e-14)


def test_large_arrays_equal_small_ones() -> None:
    a, b = random_rotations(5000), random_rotations(5000, seed=1)
    few = range(0, 5000, 100)
    for found, parts in (
        (rot.multiply(a, b), [rot.multiply(a[i : i + 100], b[i : i + 100]) for i in few]),
        (rot.to_matrix(a), [rot.to_matrix(a[i : i + 100]) for i in few]),
    ):
        np.testing.assert_allclose(found, np.concatenate(parts), rtol=0.0, atol=1e-15)


def test_a_quarter_turn_about_y_takes_z_to_x() -> None:
    quarter = rot.from_rotation_vector([0.0, np.pi / 2.0, 0.0])
    np.testing.assert_allclose(quarter, [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
    np.testing.assert_allclose(rot.rotate(quarter, [0.0, 0.0, 1.0]), [1.0, 0.0, 0.0], atol=1e-15)


def test_rotation_vector_round_trip() -> None:
    q = random_rotations()
    vectors = rot.to_rotation_vector(q)
    assert np.linalg.norm(vectors, axis=1).max() <= np.pi + 1e-12
    assert same(rot.from_rotation_vector(vectors), q) < 1e-7 * 1e-5
    np.testing.assert_allclose(rot.to_rotation_vector(-q), vectors, atol=1e-9)
    small = np.random.default_rng(3).normal(size=(50, 3)) * np.logspace(-12, -3, 50)[:, None]
    np.testing.assert_allclose(rot.to_rotation_vector(rot.from_rotation_vector(small)), small, rtol=1e-9)


def test_matrix_round_trip() -> None:
    q = random_rotations()
    matrices = rot.to_matrix(q)
    np.testing.assert_allclose(matrices, scipy_of(q).as_matrix(), atol=1e-14)
    assert same(rot.from_matrix(matrices), q) < 1e-14 * 100


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles(order: str) -> None:
    q = random_rotations()
    angles = rot.to_euler(q, order)
    assert np.abs(angles[:, 1]).max() <= np.pi / 2.0
    assert same(rot.from_euler(angles, order), q) < 1e-7
    axes = {axis: np.eye(3)[i] for i, axis in enumerate("XYZ")}
    single = [rot.from_rotation_vector(angles[:, i, None] * axes[axis]) for i, axis in enumerate(order)]
    by_hand = rot.to_matrix(single[0]) @ rot.to_matrix(single[1]) @ rot.to_matrix(single[2])
    np.testing.assert_allclose(by_hand, rot.to_matrix(q), atol=1e-7)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("middle", [np.pi / 2.0, -np.pi / 2.0])
def test_euler_angles_at_gimbal_lock(order: str, middle: float) -> None:
    first = np.linspace(-3.0, 3.0, 13)
    angles = np.stack((first, np.full(13, middle), np.full(13, 0.4)), axis=-1)
    q = rot.from_euler(angles, order)
    found = rot.to_euler(q, order)
    np.testing.assert_array_equal(found[:, 2], 0.0)
    assert same(rot.from_euler(found, order), q) < 1e-7


@pytest.mark.parametrize("order", ORDERS)
def test_unwrapped_euler_angles_are_continuous(order: str) -> None:
    """A motion through both gimbal locks and over many turns: what went into it comes back, but for whole turns."""
    time_s = np.linspace(0.0, 4.0, 401)
    true = np.stack((3.0 * time_s, 1.9 * np.sin(2.0 * time_s) + 0.2 * time_s, 0.4 - 2.5 * time_s), axis=1)
    q = rot.from_euler(true, order)
    angles = rot.unwrap_euler(rot.to_euler(q, order))
    assert same(rot.from_euler(angles, order), q) < 1e-7
    assert np.abs(np.diff(angles, axis=0)).max() < 1.01 * np.abs(np.diff(true, axis=0)).max()
    np.testing.assert_allclose(angles - angles[0], true - true[0], atol=1e-6)


def test_a_single_frame_of_euler_angles_stays() -> None:
    angles = np.array([[0.3, -0.4, 3.0]])
    np.testing.assert_array_equal(rot.unwrap_euler(angles), angles)


def test_one_angle_is_a_turn_about_one_axis() -> None:
    np.testing.assert_allclose(rot.from_euler([[0.3]], "x"), rot.from_rotation_vector([[0.3, 0.0, 0.0]]))


def test_normalize() -> None:
    np.testing.assert_allclose(rot.normalize([[0.0, 3.0, 0.0, 4.0], [0.0, 0.0, 0.0, 0.0]]),
                               [[0.0, 0.6, 0.0, 0.8], [1.0, 0.0, 0.0, 0.0]])  # fmt: skip


def test_between_is_the_shortest_rotation() -> None:
    generator = np.random.default_rng(4)
    a, b = generator.normal(size=(2, 100, 3))
    turn = rot.between(a, b)
    unit_a, unit_b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b))
    np.testing.assert_allclose(rot.rotate(turn, unit_a), unit_b, atol=1e-12)
    angles = np.linalg.norm(rot.to_rotation_vector(turn), axis=1)
    np.testing.assert_allclose(angles, np.arccos(np.sum(unit_a * unit_b, axis=1)), atol=1e-7)
    np.testing.assert_allclose(rot.between(a, a), rot.identity((100,)), atol=1e-7)
    for axis in np.eye(3):
        np.testing.assert_allclose(rot.rotate(rot.between(axis, -axis), axis), -axis, atol=1e-12)


def test_slerp_is_short_and_uniform() -> None:
    a, b = random_rotations(50), random_rotations(50, seed=5)
    whole = rot.angle_between(a, b)
    for t in (0.0, 0.25, 1.0):
        between = rot.slerp(a, -b, np.full(50, t))
        np.testing.assert_allclose(rot.angle_between(a, between), t * whole, atol=1e-7)
        np.testing.assert_allclose(rot.angle_between(between, b), (1.0 - t) * whole, atol=1e-7)
    for t in (-0.2, 1.2):  # further along the same arc, up to half a turn
        beyond = rot.multiply(
            a, rot.from_rotation_vector(t * rot.to_rotation_vector(rot.multiply(rot.conjugate(a), b)))
        )
        np.testing.assert_allclose(rot.angle_between(rot.slerp(a, -b, np.full(50, t)), beyond), 0.0, atol=1e-7)


def test_angle_between() -> None:
    q = random_rotations(20)
    turn = rot.from_rotation_vector([0.0, 0.0, 0.7])
    np.testing.assert_allclose(rot.angle_between(q, rot.multiply(q, turn)), 0.7)
    np.testing.assert_allclose(rot.angle_between(q, -q), 0.0, atol=1e-7)


def test_mean_ignores_signs() -> None:
    centre = rot.from_rotation_vector([0.4, -0.3, 0.9])
    spread = np.random.default_rng(6).normal(scale=0.2, size=(40, 3))
    around = rot.multiply(centre, rot.from_rotation_vector(np.concatenate((spread, -spread))))
    signs = np.where(np.arange(80) % 3 == 0, -1.0, 1.0)[:, None]
    assert same(rot.mean(signs * around), centre) < 1e-7
    two = np.stack((rot.identity(), rot.from_rotation_vector([0.6, 0.0, 0.0])))
    assert same(rot.mean(two), rot.from_rotation_vector([0.3, 0.0, 0.0])) < 1e-7
    assert rot.mean(np.tile(two[:, None, None], (1, 3, 2, 1))).shape == (3, 2, 4)


def test_continuous_changes_signs_only() -> None:
    time = np.linspace(0.0, 4.0 * np.pi, 60)
    q = rot.from_rotation_vector(time[:, None] * np.array([0.0, 1.0, 0.0]))
    flipped = q * np.where(np.arange(60) % 7 < 3, -1.0, 1.0)[:, None]
    result = rot.continuous(flipped)
    assert np.all(np.sum(result[1:] * result[:-1], axis=1) > 0.0)
    assert same(result, q) < 1e-7


def test_swing_times_twist_is_the_rotation() -> None:
    q = random_rotations()[6:]
    axis = np.array([0.0, 0.6, 0.8])
    swing, twist = rot.swing_twist(q, axis)
    assert same(rot.multiply(swing, twist), q) < 1e-7
    turned = rot.rotate(twist, axis)
    np.testing.assert_allclose(turned, np.broadcast_to(axis, turned.shape), atol=1e-12)
    np.testing.assert_allclose(swing[:, 1:] @ axis, 0.0, atol=1e-12)
