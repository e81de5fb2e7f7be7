"""Gaussian of neighbouring poses, conditioned on the past and fitted to markers.

The neighbours' poses, their earlier markers and their earlier poses have a joint Gaussian distribution, widened by a
share of the whole database's, which allows the movements of bodies only (a knee bends, it does not twist). The pose
given the past is a linear regression without any choice of dimension (Bishop 2006, Eq. 2.81); the continued change of
pose is a second observation. Then pose and root are fitted together to the present markers by Gauss-Newton steps under
that prior, in the form that inverts a matrix of the size of the markers, not of the pose (iterated Kalman update, Bell
and Cathey 1993).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, get_blas_funcs, solve_triangular
from scipy.linalg.blas import dgemm

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .observation import Observation, control_jacobian, control_residual
from .subject_model import RootPose, SubjectModel

_EXPECTED_SIGMA_M = 0.01  # of a marker about the prior's: skin moves, and no prior is exact
_STRAIGHT_RAD = 0.05  # a step in which no joint turns more needs no other: markers move as their derivative says


@dataclass(frozen=True)
class Prior:
    """Gaussian of the pose: mean (D,) and covariance (D, D)."""

    mean: Array
    covariance: Array


def neighbours_prior(samples: NDArray[Any], weights: Array, floor: Array) -> Prior:
    """Return the Gaussian of the neighbours.

    Args:
        samples: (K, D) neighbours.
        weights: (K,) positive, sum 1.
        floor: (D, D) covariance granted beside the neighbours' own, so that equal entries can still change.
    """
    mean = weights @ samples
    # in the precision of the samples: half of it is enough for differences
    spread = samples - mean.astype(samples.dtype)
    spread *= np.sqrt(weights).astype(samples.dtype)[:, None]
    return Prior(mean, _gram(spread) + floor)


def condition(prior: Prior, observed: Array, variances: Array) -> Prior:
    """Return the Gaussian of the first entries given the last (Bishop 2006, Eq. 2.81).

    Args:
        prior: of all entries.
        observed: (m,) the last entries; NaN where nothing was observed.
        variances: (m,) of the observations.
    """
    kept = len(prior.mean) - len(observed)
    seen = kept + np.flatnonzero(np.isfinite(observed))
    rows = prior.covariance[seen]
    innovation_covariance = rows[:, seen]
    innovation_covariance[np.diag_indices_from(innovation_covariance)] += variances[seen - kept]
    right = np.column_stack((rows[:, :kept], observed[seen - kept] - prior.mean[seen]))
    # with L L^T the innovation covariance, all that follows is products of L^-1 times these
    root = np.linalg.cholesky(innovation_covariance)
    halves = solve_triangular(root, right, lower=True, check_finite=False)
    across, innovation = halves[:, :kept], halves[:, kept]
    return Prior(prior.mean[:kept] + innovation @ across, prior.covariance[:kept, :kept] - _gram(across))


def continue_prior(prior: Prior, expected: Array, covariance: Array) -> Prior:
    """Return the product of a prior and the Gaussian of a continued motion.

    A Kalman update with the expected pose (D,) and its covariance (D, D).
    """
    gain = _solve(prior.covariance + covariance, prior.covariance).T
    return Prior(prior.mean + gain @ (expected - prior.mean), _product(gain, covariance))


def _product(left: Array, right: Array) -> Array:
    """Return left @ right by SciPy (see `_gram`), without copies of the transposes."""
    return np.asarray(dgemm(1.0, right.T, left.T)).T


def _gram(rows: NDArray[Any]) -> NDArray[Any]:
    """Return rows.T @ rows by SciPy's OpenBLAS; Blender's NumPy may be slow."""
    columns = rows.T
    return np.asarray(get_blas_funcs("gemm", (columns,))(1.0, columns, columns, trans_b=True))


def _solve(covariance: Array, right: Array) -> Array:
    """Return the inverse of a positive definite matrix times another."""
    return np.asarray(cho_solve(cho_factor(covariance, check_finite=False), right, check_finite=False))


@dataclass(frozen=True)
class Expectation:
    """Prior of a frame's pose with the markers observed in that frame.

    Args:
        prior: of the pose.
        observation: markers of the frame.
        pose, root: about which the markers are linear; the root's prior is centred there.
        root_sigma: standard deviations (m, rad) of the root.
    """

    prior: Prior
    observation: Observation
    pose: Array
    root: RootPose
    root_sigma: tuple[float, float]

    def negative_log_likelihood(self, subject: SubjectModel) -> float:
        """Return minus the logarithm of the observed markers' density, metres."""
        markers, full = subject.markers_and_jacobian(self.pose.reshape(-1, 3), self.root)
        jacobian = control_jacobian(self.observation, full)
        by_root, by_pose = jacobian[:, :6], jacobian[:, 6:]
        innovation = by_pose @ (self.pose - self.prior.mean) - control_residual(self.observation, markers)
        covariance = by_pose @ _product(self.prior.covariance, by_pose.T)
        covariance += (by_root * np.repeat(np.square(self.root_sigma), 3)) @ by_root.T
        covariance[np.diag_indices_from(covariance)] += _EXPECTED_SIGMA_M**2
        factor = np.linalg.cholesky(covariance)
        unlikely = solve_triangular(factor, innovation, lower=True, check_finite=False)
        count = len(innovation)
        return float(0.5 * unlikely @ unlikely + np.log(np.diag(factor)).sum() + 0.5 * count * np.log(2.0 * np.pi))


def fit_to_markers(
    expectation: Expectation, subject: SubjectModel, marker_variance_m2: float, steps: int
) -> tuple[Array, RootPose, int]:
    """Fit pose (D,) and root to the markers under the prior.

    The third value is the number of Gauss-Newton steps.

    Args:
        expectation: prior, observed markers, and the start.
        steps: at most.
    """
    prior, observation = expectation.prior, expectation.observation
    pose, root, start_root = expectation.pose, expectation.root, expectation.root
    shift, turn = np.zeros(3), np.zeros(3)
    root_variance = np.repeat(np.square(expectation.root_sigma), 3)[:, None]
    for taken in range(1, steps + 1):
        markers, full = subject.markers_and_jacobian(pose.reshape(-1, 3), root)
        jacobian = control_jacobian(observation, full)
        by_root, by_pose = jacobian[:, :6], jacobian[:, 6:]
        gains = np.concatenate((root_variance * by_root.T, _product(prior.covariance, by_pose.T)))
        innovation = by_pose @ (pose - prior.mean) + by_root @ np.concatenate((shift, turn))
        innovation -= control_residual(observation, markers)
        covariance = jacobian @ gains
        covariance[np.diag_indices_from(covariance)] += marker_variance_m2
        change = gains @ _solve(covariance, innovation)
        shift, turn = change[:3], change[3:6]
        moved = prior.mean + change[6:] - pose
        pose = pose + moved
        rotation = rot.multiply(start_root.rotation, rot.from_rotation_vector(turn))
        root = RootPose(rotation, start_root.position_m + shift)
        if np.max(np.abs(moved)) < _STRAIGHT_RAD:
            return pose, root, taken
    return pose, root, steps
