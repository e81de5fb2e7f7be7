"""Fit of single poses to targets of joints, near the database's motion."""

import numpy as np

from ..body.skeleton import Skeleton
from ..database.store import Database
from ..geometry.arrays import Array
from ..markers.marker_set import Marker, MarkerSet
from ..markers.subject import Subject
from ..solver.gaussian_conditioning import Expectation, Prior, fit_to_markers
from ..solver.observation import Observation
from ..solver.subject_model import RootPose, SubjectModel

_STEPS = 10  # of Gauss-Newton at most,
_ROUNDS = 3  # and again from there while a tight target is further off than
_NEAR_M, _TIGHT_M = 0.01, 0.002
_MARKER_SIGMA_M = 0.0005
_CHANGE_SHARE = 0.1  # of the database's covariance, with which a pose varies about its motion
_CHANGE_RAD = 0.02  # and beside that
_ROOT_SIGMA = (0.05, 0.05)  # m, rad, about the database's motion
_LIMIT_PERCENTILES, _LIMIT_MARGIN_RAD = (0.5, 99.5), 0.05  # of the database's joint angles
_MOST_BEYOND_RAD = 0.35
_SAMPLES = 4000  # frames that these are taken over


class BodyFit:
    """Fits poses of one skeleton.

    Args:
        joints: names (M) of those with targets, at least three.
    """

    def __init__(self, skeleton: Skeleton, database: Database, joints: tuple[str, ...]) -> None:
        markers = tuple(Marker(name, name, (0.0, 0.0, 0.0), torso=True) for name in joints)
        subject = Subject("sketch", skeleton, MarkerSet("sketch", markers))
        self.zero = database.zero_of(skeleton)
        self._model = SubjectModel(subject, self.zero)
        frames = np.arange(0, database.frames, max(1, database.frames // _SAMPLES))
        poses = np.asarray(database.poses[frames], dtype=np.float64).reshape(len(frames), -1)
        self._covariance = _CHANGE_SHARE * np.atleast_2d(np.cov(poses.T, ddof=0))
        self._covariance[np.diag_indices_from(self._covariance)] += _CHANGE_RAD**2
        margin = np.array([[-_LIMIT_MARGIN_RAD], [_LIMIT_MARGIN_RAD]])
        self._limits = np.percentile(poses, _LIMIT_PERCENTILES, axis=0) + margin

    def fit(self, pose: Array, root: RootPose, points_m: Array, sigmas_m: Array) -> tuple[Array, RootPose]:
        """Return the pose (28, 3) and root near others that meet targets.

        Args:
            points_m: (M, 3).
            sigmas_m: (M,) standard deviations.
        """
        known = Observation.of_points(points_m).smoothed(points_m, sigmas_m)
        # what the database's motion itself has is no violation
        flat = pose.ravel()
        limits = np.array((np.minimum(self._limits[0], flat), np.maximum(self._limits[1], flat)))
        for _ in range(_ROUNDS):
            expectation = Expectation(Prior(flat, self._covariance), known, root, _ROOT_SIGMA, limits)
            flat, root, _ = fit_to_markers(expectation, self._model, _MARKER_SIGMA_M, _STEPS)
            # impossible targets pull with any force: no joint goes far beyond its limits all the same
            flat = np.clip(flat, limits[0] - _MOST_BEYOND_RAD, limits[1] + _MOST_BEYOND_RAD)
            away_m = np.linalg.norm(self._model.markers(flat.reshape(-1, 3), root) - points_m, axis=1)
            if (away_m[sigmas_m < _TIGHT_M] < _NEAR_M).all():
                break
        return flat.reshape(-1, 3), root
