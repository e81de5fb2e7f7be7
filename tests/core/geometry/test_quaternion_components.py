"""Numbers and frames of components against the same formulas on arrays."""

import numpy as np
import pytest
from perfanim.core.geometry import quaternion_components as c
from perfanim.core.geometry import rotations as rot

CHANCE = np.random.default_rng(4)
A, B = CHANCE.normal(size=(2, 5, 3))
P, Q = rot.from_rotation_vector(CHANCE.normal(size=(2, 5, 3)))


@pytest.fixture(params=["numbers", "frames"])
def row(request: pytest.FixtureRequest) -> object:
    return 2 if request.param == "numbers" else slice(None)


def test_vectors(row: object) -> None:
    a, b = c.components(A[row]), c.components(B[row])
    np.testing.assert_allclose(c.stacked(c.plus(a, b)), A[row] + B[row])
    np.testing.assert_allclose(c.stacked(c.minus(a, b)), A[row] - B[row])
    np.testing.assert_allclose(c.stacked(c.times(-2.5, a)), -2.5 * A[row])
    np.testing.assert_allclose(c.stacked(c.cross(a, b)), np.cross(A[row], B[row]))
    np.testing.assert_allclose(c.dot(a, b), np.sum(A[row] * B[row], axis=-1))
    np.testing.assert_allclose(c.length(a), np.linalg.norm(A[row], axis=-1))
    np.testing.assert_allclose(c.maximum(a[0], b[0]), np.maximum(A[row], B[row])[..., 0])
    np.testing.assert_allclose(c.minimum(a[0], b[0]), np.minimum(A[row], B[row])[..., 0])
    np.testing.assert_allclose(c.stacked(c.unit(a)), A[row] / np.linalg.norm(A[row], axis=-1, keepdims=True))


def test_rotations(row: object) -> None:
    a, p, q = c.components(A[row]), c.components(P[row]), c.components(Q[row])
    np.testing.assert_allclose(c.stacked(c.rotate(p, a)), rot.rotate(P[row], A[row]), atol=1e-12)
    np.testing.assert_allclose(c.stacked(c.multiply(p, q)), rot.multiply(P[row], Q[row]), atol=1e-12)
    np.testing.assert_allclose(c.stacked(c.conjugate(p)), rot.conjugate(P[row]))
    np.testing.assert_allclose(c.stacked(c.unit_quaternion((*c.times(3.0, p[:3]), 3.0 * p[3]))), P[row], atol=1e-12)


def test_the_shortest_turn_takes_one_direction_to_the_other_about_their_normal(row: object) -> None:
    a, b = c.unit(c.components(A[row])), c.unit(c.components(B[row]))
    turn = c.shortest_turn(a, b)
    np.testing.assert_allclose(c.stacked(c.rotate(turn, a)), c.stacked(b), atol=1e-12)
    np.testing.assert_allclose(c.dot((turn[1], turn[2], turn[3]), a), 0.0, atol=1e-12)


def test_zero_vector_stays_zero() -> None:
    assert c.unit((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
