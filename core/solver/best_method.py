"""The method "best": a Gaussian of neighbours and a learned prior, fitted to the markers."""

from collections.abc import Sequence
from copy import copy
from pathlib import Path

import numpy as np

from ..database.store import Database
from ..geometry.arrays import Array
from ..geometry.principal_components import principal_components
from ..system.assets import MOTION_PRIOR
from . import gaussian_conditioning
from .best_estimate import FIT_STEPS, BestModel, best_estimate, history_of
from .database_markers import DatabaseMarkers
from .gaussian_conditioning import Expectation, Prior
from .lagged_history import LaggedFrames, LaggedHistory, LaggedMarkers, LaggedPoses
from .method import FrameProblem
from .motion_prior import MotionPrior, PriorEstimate, open_network
from .observation import Observation
from .settings import BestSettings
from .solution import Estimate
from .subject_model import RootPose, SubjectModel

_HISTORY_SHARE = 0.3  # weight of the squared distances of earlier markers relative to those of current ones
_BROAD_SAMPLES = 4096  # number of frames used for the covariance of the whole database
_NONE = 1e-20  # covariance of two entries of a pose below which they are treated as independent
_COMPONENTS = 30  # number of principal components of earlier poses that are kept
_LIMIT_PERCENTILES = (1.0, 99.0)  # percentiles of the database's joint angles that are the joint limits
_LIMIT_MARGIN_RAD = 0.05  # margin added at either end of this range


class BestMethod:
    """Method that conditions a Gaussian of the neighbours on the past and fits it to the markers.

    Attributes:
        earlier_markers: Earlier markers of the database's frames.
        model: What is known of frames with located markers.
    """

    fits_markers = True

    def __init__(
        self,
        settings: BestSettings,
        query_alpha: float,
        subject: SubjectModel,
        database: Database,
        markers: DatabaseMarkers,
    ) -> None:
        self._query_alpha, self._subject = query_alpha, subject
        self.examples, self.others_distance = settings.neighbours, settings.others_distance
        self.query_pose_m_per_rad, self.longest_s = settings.query_pose_m_per_rad, settings.history_s[-1]
        network = open_network(Path(settings.prior_file or MOTION_PRIOR)) if settings.prior_share else None
        self._learned = MotionPrior(network, subject, database.mean_rotations) if network else None
        self._known = bool(database.own_frames(subject.skeleton).any())
        self._settings = settings
        if self._learned:
            self.longest_s = max(self.longest_s, self._learned.lags_s[-1])
        poses = database.poses.reshape(database.frames, -1)
        self._broad_frames = np.arange(0, len(poses), max(1, len(poses) // _BROAD_SAMPLES))
        self._broad_poses = poses[self._broad_frames].astype(np.float64)
        earlier = LaggedFrames(database, settings.history_s)
        self.earlier_markers = LaggedMarkers(database, markers, earlier)
        self._poses = LaggedPoses(database, principal_components(self._broad_poses, _COMPONENTS), earlier)
        margin = np.array([[-_LIMIT_MARGIN_RAD], [_LIMIT_MARGIN_RAD]])
        self._limits = np.ascontiguousarray(np.percentile(self._broad_poses, _LIMIT_PERCENTILES, axis=0) + margin)
        self._prepare()

    def _prepare(self) -> None:
        """Compute the covariance that is added to the neighbours', and those of a pose about the continued motion."""
        settings, history = self._settings, history_of(self.earlier_markers, self._poses, self._broad_frames)
        broad = np.asarray(np.cov(np.concatenate((self._broad_poses, *history), axis=1).T, ddof=0))
        floor = settings.broad_share * broad
        floor[np.diag_indices_from(broad)] += settings.pose_floor_rad**2
        floor = np.where(np.abs(floor) > _NONE, floor, 0.0).astype(np.float32)
        size, share = self._broad_poses.shape[1], self._query_alpha * _HISTORY_SHARE

        def model(own: BestSettings, is_known: bool) -> BestModel:
            change = own.change_share * broad[:size, :size] + own.change_rad**2 * np.eye(size)
            earlier = self.earlier_markers, self._poses
            return BestModel(self._subject, is_known, own, share, *earlier, floor, change, self._limits)

        self._model_without_depth = model(settings, False)
        self.model = model(settings.for_known_body(), True) if self._known else self._model_without_depth

    @property
    def learns(self) -> bool:
        """Whether there is a learned prior."""
        return self._learned is not None

    def backwards(self) -> "BestMethod":
        """Return a time-reversed copy."""
        found = copy(self)
        found.earlier_markers, found._poses = self.earlier_markers.backwards(), self._poses.backwards()
        found._prepare()
        return found

    def learned_priors(self, frames: Sequence[tuple[Observation, Array]], times_s: Array) -> list[PriorEstimate | None]:
        """Return the learned priors for successive frames, computed in one batch; None where the torso is hidden.

        Args:
            frames: Observations and the markers (M, 3) expected in each.
            times_s: Their ascending times (F,).
        """
        if self._learned is None:
            return [None] * len(frames)
        recent, observed = [], LaggedHistory(self.longest_s)
        for (observation, expected_m), time_s in zip(frames, times_s.tolist(), strict=True):
            recent.append(self._learned.recent(observation.back_projected(expected_m), observed, time_s))
            seen = observation.with_torso_in_space(self._subject.torso, expected_m)
            observed = observed.remember(time_s, seen.points_m)
        return self._learned.estimate_all(recent)

    def fit_about(self, poses: Array, roots: RootPose, observations: Sequence[Observation]) -> tuple[Array, RootPose]:
        """Fit poses (F, D) and their roots to the markers, starting from the given values."""
        # the smaller covariance is used for known bodies, too, because the given trajectories are already good
        settings, covariance, limits = self.model.settings, self._model_without_depth.change, self._limits
        root_sigma, sigma_m = (settings.root_sigma_m, settings.root_sigma_rad), settings.marker_sigma_m
        fitted, rotations, places = poses.copy(), roots.rotation.copy(), roots.position_m.copy()
        for index, observation in enumerate(observations):
            root, prior = RootPose(rotations[index], places[index]), Prior(poses[index], covariance)
            expectation = Expectation(prior, observation, root, root_sigma, limits)
            fitted[index], root, _ = gaussian_conditioning.fit_to_markers(
                expectation, self._subject, sigma_m, FIT_STEPS
            )
            rotations[index], places[index] = root.rotation, root.position_m
        return fitted, RootPose(rotations, places)

    def estimate(self, problem: FrameProblem) -> Estimate:
        """Return the pose and the root that fit the markers under the prior."""
        # with rays only, the depth of a known body is a guess, so the settings for other bodies are used
        state, seen = problem.state, problem.observation
        model = self.model if seen.located.any() else self._model_without_depth
        learned = state.learned
        if self._learned and learned is None:
            if state.markers_m is not None:
                seen = seen.back_projected(state.markers_m)
            learned = self._learned.estimate(self._learned.recent(seen, state.observed, state.time_s), problem.root)
        return best_estimate(model, problem, learned if self._learned else None)
