"""The most accurate method: the nearest poses' full covariance conditioned on the markers, then fitted to them exactly.

The neighbours' poses and the markers that they show have a joint Gaussian distribution, so the expected pose given the
observed markers is a linear regression without any choice of dimension (Bishop 2006, Eq. 2.81). From there the pose
and the root are fitted together to the markers by Gauss-Newton steps under the same prior, in the form that inverts a
matrix of the size of the markers, not of the pose (iterated Kalman update, Bell and Cathey 1993).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import rotations as rot
from .observation import Observation, control_jacobian, control_residual
from .subject_model import RootPose, SubjectModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prior:
    """Gaussian of the pose around the query: mean (D,) and covariance = spread.T @ spread + floor I, spread (K, D)."""

    mean: Array
    spread: Array
    floor: float

    def times(self, matrix: Array) -> Array:
        """Return covariance @ matrix (D, n)."""
        return np.asarray(self.spread.T @ (self.spread @ matrix) + self.floor * matrix)


def conditioned_prior(
    poses: Array, markers: Array, observed: Array, weights: Array, marker_variance_m2: float, floor: float
) -> tuple[Prior, Array]:
    """Return the neighbours' Gaussian and the pose (D,) expected for the observed markers.

    Args:
        poses: (K, D) neighbours.
        markers: (K, m) their coordinates of the observed markers, metres, root at rest.
        observed: (m,) the same coordinates as observed.
        weights: (K,) positive, sum 1.
        marker_variance_m2: of the observation.
        floor: variance, rad^2, granted in every direction, so that what the neighbours share can still change.
    """
    mean = weights @ poses
    marker_mean = weights @ markers
    roots = np.sqrt(weights)[:, None]
    spread = (poses - mean) * roots
    marker_spread = (markers - marker_mean) * roots
    covariance = marker_spread.T @ marker_spread
    covariance[np.diag_indices_from(covariance)] += marker_variance_m2
    gain = np.linalg.solve(covariance, observed - marker_mean)
    return Prior(mean, spread, floor), mean + spread.T @ (marker_spread @ gain)


def fit_to_markers(
    prior: Prior,
    subject: SubjectModel,
    observation: Observation,
    pose: Array,
    root: RootPose,
    marker_variance_m2: float,
    root_sigma: tuple[float, float],
    steps: int,
) -> tuple[Array, RootPose]:
    """Return pose (D,) and root that explain the markers under the prior.

    Args:
        prior: of the pose.
        subject: markers from poses.
        observation: what was seen.
        pose, root: where to start; the root's prior is centred there.
        marker_variance_m2: of each marker coordinate.
        root_sigma: standard deviations (m, rad) of the root against its start.
        steps: Gauss-Newton steps.
    """
    start_root = root
    shift, turn = np.zeros(3), np.zeros(3)
    root_variance = np.repeat(np.square(root_sigma), 3)[:, None]
    for _ in range(steps):
        markers, full = subject.markers_and_jacobian(pose.reshape(-1, 3), root)
        jacobian = control_jacobian(observation, full)
        by_root, by_pose = jacobian[:, :6], jacobian[:, 6:]
        gains = np.concatenate((root_variance * by_root.T, prior.times(by_pose.T)))
        innovation = by_pose @ (pose - prior.mean) + by_root @ np.concatenate((shift, turn))
        innovation -= control_residual(observation, markers)
        covariance = jacobian @ gains
        covariance[np.diag_indices_from(covariance)] += marker_variance_m2
        change = gains @ np.linalg.solve(covariance, innovation)
        shift, turn = change[:3], change[3:6]
        pose = prior.mean + change[6:]
        rotation = rot.multiply(start_root.rotation, rot.from_rotation_vector(turn))
        root = RootPose(rotation, start_root.position_m + shift)
    return pose, root
