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
from scipy.linalg import get_blas_funcs, get_lapack_funcs
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dposv, dpotrf, dtrtrs

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .observation import Observation, control_jacobian, control_residual, control_sigmas
from .subject_model import RootPose, SubjectModel

_EXPECTED_SIGMA_M = 0.01  # of a marker about the prior's: skin moves, and no prior is exact
_LIMIT_RAD = 0.02  # standard deviation beyond a joint's limit
_FIRST_DAMPING, _DAMPING_GROWTH = 1.0, 4.0  # after steps that led away
_STRAIGHT_RAD = 0.05  # a step in which no joint turns more needs no other: markers move as their derivative says


@dataclass(frozen=True)
class Prior:
    """Gaussian of the pose: mean (D,) and covariance (D, D)."""

    mean: Array
    covariance: Array


def neighbours_prior(
    samples: NDArray[Any], weights: Array, floor: NDArray[Any], observed: Array, variances: Array
) -> Prior:
    """Return the Gaussian of the neighbours' first entries given the last.

    (Bishop 2006, Eq. 2.81.) In the precision of the samples: half of it is enough for differences.

    Args:
        samples: (K, D + m) neighbours.
        weights: (K,) positive, sum 1.
        floor: (D + m, D + m) covariance granted beside the neighbours' own, so that equal entries can still change.
        observed: (m,) the last entries; NaN where nothing was observed.
        variances: (m,) of the observations.
    """
    kept, seen = samples.shape[1] - len(observed), np.isfinite(observed)
    if not seen.all():
        columns = np.concatenate((np.arange(kept), kept + np.flatnonzero(seen)))
        samples, floor = samples[:, columns], floor[np.ix_(columns, columns)]
        observed, variances = observed[seen], variances[seen]
    centre, shares = samples[0], weights.astype(samples.dtype)
    spread = samples - centre
    shift = shares @ spread
    spread -= shift
    spread *= np.sqrt(shares)[:, None]
    mean = centre + shift.astype(np.float64)
    (syrk,) = get_blas_funcs(("syrk",), (samples,))
    covariance = syrk(1.0, spread.T, 1.0, floor.T)  # only the upper triangle, as all that follows needs no more
    own = covariance[kept:, kept:]
    own[np.diag_indices_from(own)] += variances
    across, moved = _regress(covariance[:kept, kept:], own, observed - mean[kept:])
    given = syrk(-1.0, across, 1.0, covariance[:kept, :kept]) if len(observed) else covariance
    return Prior(mean[:kept] + moved, _mirrored(given))


def continue_prior(prior: Prior, expected: Array, covariance: Array) -> Prior:
    """Return the product of a prior and the Gaussian of a continued motion.

    A Kalman update with the expected pose (D,) and its covariance (D, D).
    """
    across, moved = _regress(prior.covariance.T, (prior.covariance + covariance).T, expected - prior.mean)
    return Prior(prior.mean + moved, prior.covariance - _product(across, across.T))


def _regress(across: NDArray[Any], own: NDArray[Any], innovation: Array) -> tuple[NDArray[Any], Array]:
    """Return what observations (m,) tell of other entries (D,).

    Args:
        across: (D, m) covariance of the entries and the observations.
        own: (m, m) covariance of the observations, its upper triangle.
        innovation: (m,) how far they are from what was expected.

    Returns:
        The root (D, m) of the covariance that is explained, and the change of the entries' mean.
    """
    if len(own) == 0:  # which LAPACK refuses
        return across, np.zeros(len(across))
    (potrf,) = get_lapack_funcs(("potrf",), (own,))
    (trsm,) = get_blas_funcs(("trsm",), (own,))
    factor, failed = potrf(own)
    if failed:
        raise np.linalg.LinAlgError(f"the leading minor {failed} of a covariance is not positive")
    explained = np.asarray(trsm(1.0, factor, across, side=1))
    return explained, explained @ trsm(1.0, factor, innovation, trans_a=1).ravel()


def _mirrored(upper: NDArray[Any]) -> Array:
    """Return the symmetric matrix of an upper triangle."""
    return np.where(np.tri(len(upper), dtype=np.bool_), upper.T, upper).astype(np.float64)


def _product(left: Array, right: Array) -> Array:
    """Return left @ right by SciPy's OpenBLAS; Blender's NumPy may be slow."""
    return np.asarray(dgemm(1.0, right.T, left.T)).T


def _solve(covariance: Array, right: Array) -> Array:
    """Return the inverse of a positive definite matrix times another."""
    if len(covariance) == 0:  # which LAPACK refuses
        return right
    _, solved, failed = dposv(covariance.T, right)  # SciPy's functions around it take longer than a small solve
    if failed:
        raise np.linalg.LinAlgError(f"the leading minor {failed} of a covariance is not positive")
    return np.asarray(solved)


def _whiten(covariance: Array, right: Array) -> tuple[Array, Array]:
    """Return L^-1 right and L, with L L^T the covariance."""
    if len(covariance) == 0:
        return right, covariance
    factor, failed = dpotrf(covariance.T, lower=1)
    if failed:
        raise np.linalg.LinAlgError(f"the leading minor {failed} of a covariance is not positive")
    return np.asarray(dtrtrs(factor, right, lower=1)[0]), factor


@dataclass(frozen=True)
class Expectation:
    """Prior of a frame's pose with the markers observed in that frame.

    Args:
        prior: of the pose.
        observation: markers of the frame.
        root: centre of the root's prior.
        root_sigma: standard deviations (m, rad) of the root.
        limits: (2, D) least and greatest entries of a pose, in rad.
    """

    prior: Prior
    observation: Observation
    root: RootPose
    root_sigma: tuple[float, float]
    limits: Array

    def negative_log_likelihood(self, subject: SubjectModel) -> float:
        """Return minus the logarithm of the observed markers' density, metres."""
        unlikely, factor = self._innovation(subject)
        return float(
            0.5 * unlikely @ unlikely + np.log(np.diag(factor)).sum() + 0.5 * len(unlikely) * np.log(2.0 * np.pi)
        )

    def deviation(self, subject: SubjectModel) -> float:
        """Return the RMS of the markers' distances from the prior, in its deviations."""
        unlikely, _ = self._innovation(subject)
        return float(np.sqrt(unlikely @ unlikely / max(len(unlikely), 1)))

    def _innovation(self, subject: SubjectModel) -> tuple[Array, Array]:
        """Return the whitened distances of the markers, and the factor that whitens."""
        markers, full = subject.markers_and_jacobian(self.prior.mean.reshape(-1, 3), self.root)
        jacobian = control_jacobian(self.observation, full)
        by_root, by_pose = jacobian[:, :6], jacobian[:, 6:]
        innovation = -control_residual(self.observation, markers)
        covariance = by_pose @ _product(self.prior.covariance, by_pose.T)
        covariance += (by_root * np.repeat(np.square(self.root_sigma), 3)) @ by_root.T
        covariance[np.diag_indices_from(covariance)] += _EXPECTED_SIGMA_M**2
        return _whiten(covariance, innovation)


@dataclass(frozen=True)
class FitFacts:
    """How a pose was fitted.

    Args:
        steps: tried.
        sigmas_rad: (D,) standard deviations of the pose given the markers, by the last linearised model (Laplace).
        deviation: RMS distance of the markers from the prior, in its deviations.
    """

    steps: int
    sigmas_rad: Array
    deviation: float


def fit_to_markers(
    expectation: Expectation, subject: SubjectModel, marker_sigma_m: float, steps: int
) -> tuple[Array, RootPose, FitFacts]:
    """Fit pose (D,) and root to the markers under the prior, within the limits.

    A Gauss-Newton step counts only if it lowers the cost; else it is repeated damped towards where it started, in the
    metric of the prior (Levenberg 1944), so that no step leads away.

    Args:
        expectation: prior, observed markers, root and limits.
        marker_sigma_m: standard deviation of a marker's coordinate beside its noise.
        steps: at most.
    """
    sigmas_m = control_sigmas(expectation.observation, marker_sigma_m)
    covariance, mean = expectation.prior.covariance, expectation.prior.mean
    root_variances = np.repeat(np.square(expectation.root_sigma), 3)[:, None]
    # the change of root and pose from the prior is the covariance times the dual; their product is the prior's cost
    change, dual = kept = np.zeros((2, 6 + len(mean)))
    damping, least = 0.0, np.inf
    taken = 0
    beyond_rad = _beyond_limits(mean, expectation.limits)
    while taken < steps:
        taken += 1
        residual, jacobian = _linearise(expectation, subject, change, beyond_rad, sigmas_m)
        cost = float(residual @ residual) + float(change @ dual)
        if cost > least:
            change, dual = kept
            damping = max(_FIRST_DAMPING, _DAMPING_GROWTH * damping)
        else:
            least, kept, damping = cost, np.array((change, dual)), damping / _DAMPING_GROWTH**2
            gains = np.concatenate((root_variances * jacobian[:, :6].T, _product(covariance, jacobian[:, 6:].T)))
            across, innovation, slopes = jacobian @ gains, jacobian @ change - residual, jacobian
            is_within = beyond_rad == 0.0
        share = 1.0 / (1.0 + damping)
        system = share * across
        system[np.diag_indices_from(system)] += 1.0
        forces = share * _solve(system, innovation - (1.0 - share) * (slopes @ change))
        change = (1.0 - share) * change + gains @ forces
        dual = (1.0 - share) * dual + slopes.T @ forces
        beyond_rad = _beyond_limits(mean + change[6:], expectation.limits)
        # limits that were passed before are in the linear model
        passed_rad = np.abs(beyond_rad[is_within]).max(initial=0.0)
        if max(np.abs(change - kept[0])[3:].max(), passed_rad) < _STRAIGHT_RAD:
            break
    else:
        change = kept[0]  # the last step was not tried
    across[np.diag_indices_from(across)] += 1.0
    facts = _facts(taken, covariance, across, gains[6:], innovation)
    return mean + change[6:], moved_root(expectation.root, change), facts


def _facts(steps: int, covariance: Array, system: Array, gains: Array, innovation: Array) -> FitFacts:
    """Return the facts of a fit from its last step's system (m, m) and gains (D, m)."""
    halves, _ = _whiten(system, np.column_stack((gains.T, innovation)))
    *explained, unlikely = np.einsum("md,md->d", halves, halves)
    sigmas_rad = np.sqrt(np.maximum(np.diag(covariance) - explained, 0.0))
    return FitFacts(steps, sigmas_rad, float(np.sqrt(unlikely / max(len(halves), 1))))


def _linearise(
    expectation: Expectation, subject: SubjectModel, change: Array, beyond_rad: Array, sigmas_m: Array
) -> tuple[Array, Array]:
    """Return whitened residuals of markers and limits, and their Jacobian."""
    pose = expectation.prior.mean + change[6:]
    markers, full = subject.markers_and_jacobian(pose.reshape(-1, 3), moved_root(expectation.root, change))
    beyond = np.flatnonzero(beyond_rad)
    limits = np.zeros((len(beyond), full.shape[-1]))
    limits[np.arange(len(beyond)), 6 + beyond] = 1.0 / _LIMIT_RAD
    residual = control_residual(expectation.observation, markers) / sigmas_m
    jacobian = control_jacobian(expectation.observation, full) / sigmas_m[:, None]
    return np.concatenate((residual, beyond_rad[beyond] / _LIMIT_RAD)), np.concatenate((jacobian, limits))


def _beyond_limits(pose: Array, limits: Array) -> Array:
    """Return by how much the entries of a pose (D,) are outside the limits (2, D)."""
    return np.asarray(pose - np.minimum(np.maximum(pose, limits[0]), limits[1]))


def moved_root(root: RootPose, change: Array) -> RootPose:
    """Return roots after changes (..., 6 or more): shift, turn, ..."""
    rotation = rot.multiply(root.rotation, rot.from_rotation_vector(change[..., 3:6]))
    return RootPose(rotation, root.position_m + change[..., :3])
