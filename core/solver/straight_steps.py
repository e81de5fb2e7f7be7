"""First steps of very many fits at once.

The poses of a solved take lie so close to their markers that one Gauss-Newton step is enough for nearly all. That of
`fit_to_markers` needs nothing of other frames, so it is taken for many together, in a fraction of the time.
"""

from collections.abc import Sequence

import numpy as np

from ..geometry.arrays import Array, Mask
from .gaussian_conditioning import STRAIGHT_RAD, Prior, beyond_limits
from .observation import Observation
from .subject_model import RootPose, SubjectModel


def straight_steps(
    prior: Prior,
    roots: RootPose,
    root_sigma: tuple[float, float],
    observations: Sequence[Observation],
    limits: Array,
    subject: SubjectModel,
    marker_sigma_m: float,
) -> tuple[Array, Mask]:
    """Return first changes (F, 6 + D) of roots and poses, and the sufficient (F,).

    Args:
        prior: with means (F, D) of one covariance (D, D).
        roots: as many.
        root_sigma, limits, marker_sigma_m: as of `Expectation` and `fit_to_markers`.
        observations: those with markers that single cameras saw need more than this step.
    """
    poses = prior.mean
    markers, jacobian = subject.markers_and_jacobian(poses.reshape(len(poses), -1, 3), roots)
    points_m = np.array([observation.points_m for observation in observations])
    located = np.array([observation.located for observation in observations])[..., None]
    noises = (observation.noise_m for observation in observations)
    noise_m = np.array([np.zeros(markers.shape[1]) if noise_m is None else noise_m for noise_m in noises])
    # rows of hidden markers are zero, so that all frames have as many
    shares = located / np.hypot(marker_sigma_m, noise_m)[..., None]
    residual = (np.where(located, markers - points_m, 0.0) * shares).reshape(len(poses), -1)
    rows = (jacobian * shares[..., None]).reshape(*residual.shape, -1)
    gains = np.empty_like(rows)
    gains[..., :6] = rows[..., :6] * np.repeat(np.square(root_sigma), 3)
    gains[..., 6:] = rows[..., 6:] @ prior.covariance
    system = gains @ rows.swapaxes(1, 2)
    system += np.eye(rows.shape[1])
    forces = np.linalg.solve(system, -residual[..., None])
    change = (gains.swapaxes(1, 2) @ forces)[..., 0]
    passed_rad = np.abs(beyond_limits(poses + change[:, 6:], limits)).max(axis=1)
    is_straight = np.maximum(np.abs(change[:, 3:]).max(axis=1), passed_rad) < STRAIGHT_RAD
    is_straight &= ~beyond_limits(poses, limits).any(axis=1)
    is_straight &= ~np.array([observation.single.any() for observation in observations])
    return change, is_straight
