"""Pose of least energy (Eq. 5-9), by Levenberg-Marquardt."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...geometry.arrays import Array
from ..observation import Observation, control_jacobian, control_residual
from ..subject_model import RootPose, SubjectModel
from .local_model import LocalModel

_ITERATIONS = 12  # largest number of iterations
_RELATIVE_DECREASE = 1e-4  # relative decrease of the energy below which the iterations end
_DAMPING_START, _DAMPING_DOWN, _DAMPING_UP, _DAMPING_MAX = 1e-3, 0.3, 8.0, 1e6


@dataclass(frozen=True)
class SynthesisProblem:
    """Terms of Eq. 9 for one frame."""

    model: LocalModel  # hard constraint in Eq. 9
    subject: SubjectModel  # markers from poses
    root: RootPose  # z_t
    observation: Observation  # c_t
    continued_pose: Array | None  # (D,) 2 q_{t-1} - q_{t-2}; None at the start
    control_weight: float  # factor for the squared marker distances, 1/m^2
    smoothness_weight: float  # factor for the squared pose differences, 1/rad^2

    def residual(self, weights: Array) -> Array:
        """Return prior, control and smoothness terms; their squared sum is Eq. 9 plus a constant."""
        markers = self.subject.markers(self.model.pose(weights).reshape(-1, 3), self.root)
        return self._stacked(weights, control_residual(self.observation, markers))

    def residual_and_jacobian(self, weights: Array) -> tuple[Array, Array]:
        """Return `residual` and its derivatives (rows, B) with respect to the weights."""
        pose = self.model.pose(weights).reshape(-1, 3)
        markers, by_pose = self.subject.markers_and_jacobian(pose, self.root)
        by_weights = by_pose[:, :, 6:] @ self.model.basis
        rows = [
            np.diag(self.model.variances**-0.5),
            np.sqrt(self.control_weight) * control_jacobian(self.observation, by_weights),
        ]
        if self._smooth_weights is not None:
            rows.append(np.sqrt(self.smoothness_weight) * np.eye(self.model.dimensions))
        residual = self._stacked(weights, control_residual(self.observation, markers))
        return residual, np.concatenate(rows)

    @cached_property
    def _smooth_weights(self) -> Array | None:
        """Weights of the continued pose; Eq. 8 is the distance from these."""
        if self.continued_pose is None or self.smoothness_weight == 0.0:
            return None
        return self.model.weights(self.continued_pose)

    def _stacked(self, weights: Array, control: Array) -> Array:
        parts = [weights * self.model.variances**-0.5, np.sqrt(self.control_weight) * control]
        if self._smooth_weights is not None:
            parts.append(np.sqrt(self.smoothness_weight) * (weights - self._smooth_weights))
        return np.concatenate(parts)


def solve(problem: SynthesisProblem, start: Array) -> tuple[Array, int]:
    """Return the weights (B,) of least energy, and the number of iterations from the weights `start`.

    Levenberg-Marquardt with Marquardt's scaling; the paper starts from the closest example.
    """
    weights = start
    residual, jacobian = problem.residual_and_jacobian(weights)
    energy = residual @ residual
    damping = _DAMPING_START
    for iteration in range(1, _ITERATIONS + 1):
        normal = jacobian.T @ jacobian
        gradient = jacobian.T @ residual
        while True:
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -gradient)
            trial = problem.residual(weights + step)
            trial_energy = trial @ trial
            if trial_energy <= energy or damping > _DAMPING_MAX:
                break
            damping *= _DAMPING_UP
        if trial_energy > energy:
            return weights, iteration
        decrease = energy - trial_energy
        weights = weights + step
        damping *= _DAMPING_DOWN
        if decrease <= _RELATIVE_DECREASE * energy:
            return weights, iteration
        residual, jacobian = problem.residual_and_jacobian(weights)
        energy = residual @ residual
    return weights, _ITERATIONS
