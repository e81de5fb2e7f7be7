"""Gaussians of a pose, conditioned on more observations and fitted to markers.

To the neighbours' prior (see `neighbours_prior`), the pose expected from the continued motion is a second observation.
Then pose and root are fitted together to the current markers by Gauss-Newton steps under that prior, in the dual form,
which inverts a matrix of the size of the markers, not of the pose (iterated Kalman update, Bell and Cathey 1993).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..kernel.library import address, checked, contiguous, function, stage
from .observation import Observation, control_jacobian, control_residual, control_sigmas
from .subject_model import RootPose, SubjectModel

EXPECTED_SIGMA_M = 0.01  # standard deviation of a marker about its position on the body: skin motion and model errors
_LIMIT_RAD = 0.02  # standard deviation of the part of an angle that is beyond the joint's limit
_FIRST_DAMPING, _DAMPING_GROWTH = 1.0, 4.0  # damping after a step increased the cost, and its growth after more
_STRAIGHT_RAD = 0.05  # largest rotation in a step for which the model is linear enough to stop
FIT_SETTINGS = (_STRAIGHT_RAD, _LIMIT_RAD, _FIRST_DAMPING, _DAMPING_GROWTH)


class Prior(NamedTuple):
    """Gaussian of a pose: mean (D,) and covariance (D, D)."""

    mean: Array
    covariance: Array


_CONTINUE = function("continue_prior", "nppppppp")


def _compiled_continue(prior: Prior, expected: Array, covariance: Array) -> Prior:
    size = len(prior.mean)
    work, mean, result = np.empty(2 * size * (2 * size + 4)), np.empty(size), np.empty((size, size))
    given = map(contiguous, (*prior, expected, covariance))
    checked(_CONTINUE(size, *given, address(work), address(mean), address(result)))
    return Prior(mean, result)


@stage(_compiled_continue)
def continue_prior(prior: Prior, expected: Array, covariance: Array) -> Prior:
    """Return a prior updated with a second estimate of the pose: its mean (D,) and covariance (D, D)."""
    return conditioned(prior, prior.covariance, prior.covariance + covariance, expected - prior.mean)


def conditioned(prior: Prior, across: Array, own: Array, innovation: Array) -> Prior:
    """Return a Gaussian (D,) given observations (m,) of other variables (Bishop 2006, Eq. 2.81).

    Args:
        across: Covariance (D, m) with the observations.
        own: Covariance (m, m) of the observations.
        innovation: Observations (m,) minus their expectation.

    Raises:
        LinAlgError: The observations' covariance is not positive definite.
    """
    whitened = _whiten(own, np.column_stack((across.T, innovation)))[0]
    explained = whitened[:, :-1].T  # a square root (D, m) of the explained covariance
    return Prior(prior.mean + explained @ whitened[:, -1], prior.covariance - explained @ explained.T)


def widen_joints(prior: Prior, other: Prior, inflations: Array, share: float) -> Prior:
    """Return a prior with the variances of joints inflated, most where another prior differs.

    Args:
        inflations: Factor (J - 1,) for each joint's variances; factors below 1 are replaced by 1.
        share: A joint's variances are further multiplied by `share` times its inflation times the squared distance
            between the two means, divided by the sum of the two variances, where this exceeds 1.

    Returns:
        The prior with scaled rows and columns; correlations are unchanged.
    """
    shift, mine, others = (
        np.add.reduce(each.reshape(-1, 3), axis=1)
        for each in (np.square(prior.mean - other.mean), prior.covariance.diagonal(), other.covariance.diagonal())
    )
    apart = np.maximum(1.0, share * inflations * shift / (mine + others))
    widened = np.repeat(np.sqrt(np.maximum(1.0, inflations) * apart), 3)
    return Prior(prior.mean, prior.covariance * widened * widened[:, None])


def _add_to_diagonal(matrix: Array, values: Array | float) -> None:
    matrix.flat[:: len(matrix) + 1] += values  # faster than diag_indices


def _whiten(covariance: Array, right: Array) -> tuple[Array, Array]:
    """Return L^-1 right (..., m, n) and L, where L L^T is the covariance (..., m, m)."""
    factor = np.linalg.cholesky(covariance)
    return np.linalg.solve(factor, right), factor


@dataclass(frozen=True)
class Expectation:
    """Prior for a frame's pose and root, with the markers observed in that frame."""

    prior: Prior
    observation: Observation
    root: RootPose  # mean of the root's prior
    root_sigma: tuple[float, float]  # standard deviations (m, rad) of the root
    limits: Array  # (2, D) smallest and largest values of a pose's entries, rad

    def negative_log_likelihood(self, subject: SubjectModel) -> float:
        """Return the negative log density of the observed markers, for positions in metres."""
        found = innovations([self.prior], self.observation, self.root, self.root_sigma, subject)
        unlikely, scales = found[0][0], found[1][0]
        return float(0.5 * unlikely @ unlikely + np.log(scales).sum() + 0.5 * len(unlikely) * np.log(2.0 * np.pi))


def deviations(
    priors: Sequence[Prior],
    observation: Observation,
    root: RootPose,
    root_sigma: tuple[float, float],
    subject: SubjectModel,
) -> list[float]:
    """Return the RMS distance of the markers from each prior, in standard deviations of that prior."""
    unlikely = innovations(priors, observation, root, root_sigma, subject)[0]
    return [float(np.sqrt(rows @ rows / max(len(rows), 1))) for rows in unlikely]


_INNOVATION = function("innovation", "ppppppppppppp")


def _compiled_innovations(
    priors: Sequence[Prior],
    observation: Observation,
    root: RootPose,
    root_sigma: tuple[float, float],
    subject: SubjectModel,
) -> tuple[Array, Array]:
    *controls, counts = _addresses(observation, subject)
    rows, markers, width = len(observation.controls.markers), len(subject.joints), 6 + len(priors[0].mean)
    work, found = np.empty(3 * markers * (1 + width) + rows * (2 * width + rows + 4)), np.empty((2, len(priors), rows))
    place = np.concatenate((root.matrix.ravel(), root.position_m))
    frame = contiguous(place), contiguous((*root_sigma, EXPECTED_SIGMA_M)), address(work)
    for index, prior in enumerate(priors):
        given = contiguous(counts, np.int64), *controls, contiguous(prior.mean), contiguous(prior.covariance)
        checked(_INNOVATION(*given, *frame, address(found[0, index]), address(found[1, index])))
    return found[0], found[1]


def _addresses(observation: Observation, subject: SubjectModel) -> tuple[Any, ...]:
    """Return what `Controls` of the kernel has, and its counts."""
    body, controls = subject.body, observation.controls
    counts = np.array([body.joint_count, len(body.joints), len(body.carriers), len(controls.markers)])
    tables = address(body.indices), address(body.lengths)
    rows = contiguous(controls.markers, np.int64), contiguous(controls.axes), contiguous(controls.origins_m)
    return *tables, *rows, counts


@stage(_compiled_innovations)
def innovations(
    priors: Sequence[Prior],
    observation: Observation,
    root: RootPose,
    root_sigma: tuple[float, float],
    subject: SubjectModel,
) -> tuple[Array, Array]:
    """Return whitened deviations (P, R) of the markers from P priors, and the diagonals (P, R) of their factors."""
    poses = np.array([prior.mean.reshape(-1, 3) for prior in priors])
    residuals, covariances = [], []
    for prior, markers, full in zip(priors, *subject.markers_and_jacobian(poses, root), strict=True):
        residuals.append(-control_residual(observation, markers))
        jacobian = control_jacobian(observation, full)
        covariances.append(observed_covariance(jacobian, np.repeat(np.square(root_sigma), 3), prior.covariance)[1])
        _add_to_diagonal(covariances[-1], EXPECTED_SIGMA_M**2)
    whitened, factors = _whiten(np.array(covariances), np.array(residuals)[..., None])
    return whitened[..., 0], factors.diagonal(axis1=1, axis2=2)


def observed_covariance(jacobian: Array, root_variances: Array, covariance: Array) -> tuple[Array, Array]:
    """Return the covariance (6 + D, m) of root and pose with observations, and that of the observations (m, m).

    Args:
        jacobian: Jacobian J (m, 6 + D) of the observations.
        root_variances: Variances (6,) of the root, which is independent of the pose.
        covariance: Covariance (D, D) of the pose.
    """
    by_root, by_pose = jacobian[:, :6], jacobian[:, 6:]
    gains = np.concatenate((root_variances[:, None] * by_root.T, covariance @ by_pose.T))
    return gains, jacobian @ gains


_FIT = function("fit_to_markers", "pppppppppppppnpppp")


def _compiled_fit(
    expectation: Expectation,
    subject: SubjectModel,
    marker_sigma_m: float,
    steps: int,
    straight_rad: float = _STRAIGHT_RAD,
) -> tuple[Array, RootPose, int]:
    prior, observation, root = expectation.prior, expectation.observation, expectation.root
    *controls, counts = _addresses(observation, subject)
    size, markers = len(prior.mean), len(subject.joints)
    width, most = 6 + size, len(observation.controls.markers) + size
    work = np.empty(3 * markers * (1 + width) + most * (3 * width + 2 * most + 7) + 4 * width + 2 * size)
    pose, fitted, taken = np.empty(size), np.empty(7), np.empty(1, dtype=np.int64)
    limits = np.empty((2, size))
    limits[...] = expectation.limits
    place = np.concatenate((root.rotation, root.position_m))
    settings = (straight_rad, *FIT_SETTINGS[1:])
    sigmas_m = control_sigmas(observation, marker_sigma_m)
    values: Any = (sigmas_m, *prior, place, expectation.root_sigma, limits, settings)
    given = (contiguous(each) for each in values)
    checked(
        _FIT(
            contiguous(counts, np.int64),
            *controls,
            *given,
            steps,
            address(work),
            address(pose),
            address(fitted),
            address(taken),
        )
    )
    return pose, RootPose(fitted[:4], fitted[4:]), int(taken[0])


@stage(_compiled_fit)
def fit_to_markers(
    expectation: Expectation,
    subject: SubjectModel,
    marker_sigma_m: float,
    steps: int,
    straight_rad: float = _STRAIGHT_RAD,
) -> tuple[Array, RootPose, int]:
    """Fit pose (D,) and root to the markers under the prior, within the limits; return them and the number of steps.

    A Gauss-Newton step that does not lower the cost is repeated with damping in the metric of the prior (Levenberg
    1944).

    Args:
        marker_sigma_m: Standard deviation of a marker's coordinate in addition to its noise.
        steps: Largest number of steps.
        straight_rad: Largest rotation in a step for which the model is linear enough to stop.
    """
    sigmas_m = control_sigmas(expectation.observation, marker_sigma_m)
    covariance, mean = expectation.prior.covariance, expectation.prior.mean
    root_variances = np.repeat(np.square(expectation.root_sigma), 3)
    # the change of root and pose from the prior mean is the prior covariance times `dual`; change @ dual is the cost
    # of the prior
    change, dual = kept = np.zeros((2, 6 + len(mean)))
    root, damping, least = expectation.root, 0.0, np.inf
    taken = 0
    beyond_rad = beyond_limits(mean, expectation.limits)
    while taken < steps:
        taken += 1
        residual, jacobian = _linearise(expectation, subject, mean + change[6:], root, beyond_rad, sigmas_m)
        cost = float(residual @ residual) + float(change @ dual)
        if cost > least:
            change, dual = kept
            damping = max(_FIRST_DAMPING, _DAMPING_GROWTH * damping)
        else:
            least, kept, damping = cost, np.array((change, dual)), damping / _DAMPING_GROWTH**2
            gains, across = observed_covariance(jacobian, root_variances, covariance)
            innovation, slopes = jacobian @ change - residual, jacobian
            is_within = beyond_rad == 0.0
        share = 1.0 / (1.0 + damping)
        system = share * across
        _add_to_diagonal(system, 1.0)
        forces = share * np.linalg.solve(system, innovation - (1.0 - share) * (slopes @ change))
        change = (1.0 - share) * change + gains @ forces
        dual = (1.0 - share) * dual + slopes.T @ forces
        root = moved_root(expectation.root, change)
        beyond_rad = beyond_limits(mean + change[6:], expectation.limits)
        # joint limits that were already exceeded are part of the linear model
        passed_rad = np.abs(beyond_rad[is_within]).max(initial=0.0)
        if max(np.abs(change - kept[0])[3:].max(), passed_rad) < straight_rad:
            break
    else:
        change = kept[0]  # the cost after the last step is unknown, so the state before it is returned
        root = moved_root(expectation.root, change)
    return mean + change[6:], root, taken


def _linearise(
    expectation: Expectation, subject: SubjectModel, pose: Array, root: RootPose, beyond_rad: Array, sigmas_m: Array
) -> tuple[Array, Array]:
    """Return whitened residuals of markers and limits, and their Jacobian."""
    markers, full = subject.markers_and_jacobian(pose.reshape(-1, 3), root)
    residual = control_residual(expectation.observation, markers) / sigmas_m
    jacobian = control_jacobian(expectation.observation, full) / sigmas_m[:, None]
    beyond = np.flatnonzero(beyond_rad)
    if len(beyond) == 0:
        return residual, jacobian
    limits = np.zeros((len(beyond), full.shape[-1]))
    limits[np.arange(len(beyond)), 6 + beyond] = 1.0 / _LIMIT_RAD
    return np.concatenate((residual, beyond_rad[beyond] / _LIMIT_RAD)), np.concatenate((jacobian, limits))


def beyond_limits(pose: Array, limits: Array) -> Array:
    """Return how far the entries of poses (..., D) exceed the limits (2, D)."""
    return np.asarray(pose - np.minimum(np.maximum(pose, limits[0]), limits[1]))


def moved_root(root: RootPose, change: Array) -> RootPose:
    """Return roots moved by the first six entries of changes (..., n): translation, then rotation vector."""
    rotation = rot.multiply(root.rotation, rot.from_rotation_vector(change[..., 3:6]))
    return RootPose(rotation, root.position_m + change[..., :3])
