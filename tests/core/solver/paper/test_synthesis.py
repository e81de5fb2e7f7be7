import numpy as np
import pytest
from perfanim.core.database.store import pose_from_rotations
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.paper.local_model import fit
from perfanim.core.solver.paper.synthesis import SynthesisProblem, solve
from perfanim.core.solver.subject_model import RootPose

CONTROL, SMOOTH = 0.8 / 0.003**2, 0.2 / 0.3**2


@pytest.fixture(scope="module")
def problem(model, database, truth, true_markers):
    """The model of walking about one frame of the clip that is left out, with noise of 2 mm on its markers."""
    poses = np.asarray(database.poses, dtype=np.float64).reshape(database.frames, -1)
    pose = pose_from_rotations(truth.rotations[10], database.mean_rotations).ravel()
    neighbours = poses[np.argsort(np.linalg.norm(poses - pose, axis=1))[:80]]
    points = true_markers[10] + np.random.default_rng(0).normal(scale=0.002, size=(8, 3))
    root = RootPose(truth.rotations[10, 0], truth.root_positions_m[10])
    return SynthesisProblem(fit(neighbours, 15), model, root, Observation.of_points(points), pose, CONTROL, SMOOTH)


def energy(problem, weights):
    residual = problem.residual(weights)
    return residual @ residual


@pytest.mark.parametrize("seed", range(4))
def test_jacobian_is_the_derivative(problem, seed):
    weights = np.random.default_rng(seed).normal(size=15) * np.sqrt(problem.model.variances)
    residual, jacobian = problem.residual_and_jacobian(weights)
    np.testing.assert_allclose(residual, problem.residual(weights), atol=1e-9)
    step = 1e-6
    expected = [(problem.residual(weights + c) - problem.residual(weights - c)) / (2 * step) for c in step * np.eye(15)]
    # residuals of up to some hundred: rounding of 1e-13 over the step
    np.testing.assert_allclose(jacobian, np.stack(expected, axis=-1), atol=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_minimum_is_found_from_anywhere(problem, seed):
    generator = np.random.default_rng(seed)
    start = generator.normal(size=15) * np.sqrt(problem.model.variances)
    found, iterations = solve(problem, start)
    assert 1 <= iterations <= 12
    assert energy(problem, found) <= energy(problem, start)
    residual, jacobian = problem.residual_and_jacobian(found)
    # the gradient is zero up to what one more step could gain: the last decrease was below 1e-4 of the energy
    gain = residual @ jacobian @ np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ residual)
    assert gain < 1e-3 * (residual @ residual)
    for change in generator.normal(size=(20, 15)) * 0.1 * np.sqrt(problem.model.variances):
        assert energy(problem, found + change) > (1.0 - 1e-3) * energy(problem, found)


def test_energy_never_rises_from_a_distant_start(problem):
    for seed in range(10):
        start = 8.0 * np.random.default_rng(seed).normal(size=15) * np.sqrt(problem.model.variances)
        assert energy(problem, solve(problem, start)[0]) <= energy(problem, start)


def test_terms_count_by_their_weights(problem, true_markers):
    def with_weights(control, smooth):
        other = SynthesisProblem(problem.model, problem.subject, problem.root, problem.observation,
                                 problem.continued_pose, control, smooth)  # fmt: skip
        return solve(other, np.zeros(15))[0]

    np.testing.assert_allclose(with_weights(1e-12, 0.0), 0.0, atol=1e-6)  # the prior alone: its mean
    target = problem.model.weights(problem.continued_pose)
    np.testing.assert_allclose(with_weights(1e-12, 1e12), target, atol=1e-6)  # smoothness alone: the motion goes on

    def marker_error(weights):
        markers = problem.subject.markers(problem.model.pose(weights).reshape(-1, 3), problem.root)
        return np.sqrt(np.mean(np.sum((markers - problem.observation.points_m) ** 2, axis=1)))

    tight, loose = marker_error(with_weights(100 * CONTROL, 0.0)), marker_error(with_weights(0.001 * CONTROL, 0.0))
    assert tight < marker_error(np.zeros(15))
    assert tight < loose


def test_the_start_of_a_motion_has_no_smoothness(problem):
    start = SynthesisProblem(problem.model, problem.subject, problem.root, problem.observation, None, CONTROL, SMOOTH)
    assert len(start.residual(np.zeros(15))) == len(problem.residual(np.zeros(15))) - 15
    assert energy(start, solve(start, np.zeros(15))[0]) < energy(start, np.zeros(15))
