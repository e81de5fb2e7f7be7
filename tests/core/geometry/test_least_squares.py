import numpy as np
import pytest
from perfanim.core.geometry.least_squares import NormalEquations, gauss_newton, levenberg_marquardt

TIMES_S = np.linspace(0.0, 1.0, 9)


def decay(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return samples (..., 9) of size * exp(-rate t), and their derivatives (..., 9, 2)."""
    size, rate = values[..., :1], values[..., 1:]
    shape = np.exp(-rate * TIMES_S)
    return size * shape, np.stack((shape, -size * TIMES_S * shape), axis=-1)


TRUTH = np.array([[2.0, 1.0], [3.0, 0.2], [0.5, 2.0]])


def test_gauss_newton_fits_a_batch_of_curves() -> None:
    def linearise(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        samples, slopes = decay(values)
        return samples - decay(TRUTH)[0], slopes

    found, residuals, jacobian = gauss_newton(TRUTH * [0.9, 1.2], linearise, 10, smallest=1e-9)
    np.testing.assert_allclose(found, TRUTH, atol=1e-8)
    np.testing.assert_allclose(residuals, 0.0, atol=1e-8)
    np.testing.assert_allclose(jacobian, decay(found)[1])


@pytest.mark.parametrize(("steps", "smallest", "expected"), [(0, 0.0, 0), (3, 0.0, 3), (9, 0.2, 3), (9, 10.0, 0)])
def test_gauss_newton_ends_after_its_steps_or_at_a_small_one(steps: int, smallest: float, expected: int) -> None:
    moves = []

    def linearise(value: float) -> tuple[np.ndarray, np.ndarray]:
        return np.array([value]), np.array([[2.0]])  # each step halves the value

    def move(value: float, step: np.ndarray) -> float:
        moves.append(float(step[0]))
        return value - float(step[0])

    found, residuals, _ = gauss_newton(2.0, linearise, steps, smallest=smallest, move=move)
    assert moves == [1.0, 0.5, 0.25][:expected]
    assert residuals == [found]


def rosenbrock(values: np.ndarray) -> NormalEquations:
    x, y = values
    residuals = np.array([10.0 * (y - x * x), 1.0 - x])
    jacobian = np.array([[-20.0 * x, 10.0], [-1.0, 0.0]])
    return NormalEquations(jacobian.T @ jacobian, jacobian.T @ residuals, float(residuals @ residuals))


def test_levenberg_marquardt_follows_a_curved_valley_downwards() -> None:
    costs = []

    def linearise(values: np.ndarray) -> NormalEquations:
        costs.append(rosenbrock(values).cost)
        return rosenbrock(values)

    found, near = levenberg_marquardt(np.array([-1.2, 1.0]), linearise, np.add)
    np.testing.assert_allclose(found, 1.0, atol=1e-6)
    assert near.cost == min(costs) < 1e-12
    early, near = levenberg_marquardt(np.array([-1.2, 1.0]), rosenbrock, np.add, steps=4)
    assert near.cost == rosenbrock(early).cost < rosenbrock(np.array([-1.2, 1.0])).cost


def test_levenberg_marquardt_leaves_undetermined_values_alone() -> None:
    def linearise(values: np.ndarray) -> NormalEquations:
        return NormalEquations(np.diag([1.0, 0.0]), np.array([values[0] - 3.0, 0.0]), float((values[0] - 3.0) ** 2))

    np.testing.assert_allclose(levenberg_marquardt(np.array([0.0, 7.0]), linearise, np.add)[0], [3.0, 7.0])
