"""The method "best": a Gaussian of neighbours and a learned prior, fitted to the markers."""

from collections.abc import Sequence
from copy import copy
from pathlib import Path

import numpy as np

from ..database.store import Database
from ..geometry.arrays import Array, FloatArray, IntArray
from ..geometry.principal_components import principal_components
from ..system.assets import MOTION_PRIOR
from . import gaussian_conditioning
from .database_markers import DatabaseMarkers
from .gaussian_conditioning import Expectation, Prior, continue_prior, deviations, widen_joints
from .lagged_history import LaggedFrames, LaggedHistory, LaggedMarkers, LaggedPoses
from .method import FrameProblem
from .motion_prior import MotionPrior, PriorEstimate, open_network
from .neighbours_prior import Neighbours, neighbours_prior
from .observation import Observation
from .settings import BestSettings
from .solution import Estimate
from .subject_model import RootPose, SubjectModel

_HISTORY_SHARE = 0.3  # weight of the squared distances of earlier markers relative to those of current ones
_BROAD_SAMPLES = 4096  # number of frames used for the covariance of the whole database
_NONE = 1e-20  # covariance of two entries of a pose below which they are treated as independent
_COMPONENTS = 30  # number of principal components of earlier poses that are kept
_FIT_STEPS = 8  # largest number of Gauss-Newton steps; one is usually enough
# Ratio of the markers' distance from the neighbours to their distance from the learned prior, each in standard
# deviations, at which neighbours and prior have equal weight; for bodies that are not in the database, and for those
# that are. The fourth power of the actual ratio, relative to this one, is the factor of the neighbours' variances.
_TRUSTED, _TRUSTED_KNOWN = 1.3, 5.0
# standard deviations of the learned prior's root, relative to the torso markers', above which these locate the root
_VAGUE = 3.0
_MOST_INFLATION = 100.0
# For bodies that are not in the database, a joint's variances are inflated further where neighbours and learned prior
# differ by more than their standard deviations. For example, people hold their hands and heads differently while
# walking.
_JOINT_INFLATION_SHARE = 0.3  # factor of this further inflation, see `widen_joints`
# Lower bound on the markers' distance from the learned prior, in standard deviations, for joints whose markers are all
# hidden. A vague prior is close to any markers, and the markers of other joints say little about these.
_LEAST_OFF = 0.8
# Distance of the markers from the neighbours, in standard deviations, above which the neighbours' Gaussian is widened
# in proportion if the body is in the database: above it, the body moves in a new way.
_USUAL_DEVIATION = 0.5
# Factors of the uncertainty, found with the scales of `session.part_errors`:
_KNOWN_SHARE = 0.5  # for bodies that are in the database
_ALONE = 2.0  # without a learned prior, because the neighbours understate it
_LIMIT_PERCENTILES = (1.0, 99.0)  # percentiles of the database's joint angles that are the joint limits
_LIMIT_MARGIN_RAD = 0.05  # margin added at either end of this range


class BestMethod:
    """Method that conditions a Gaussian of the neighbours on the past and fits it to the markers.

    Attributes:
        earlier_markers: Earlier markers of the database's frames.
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
        self._settings = settings.for_known_body() if self._known else settings
        self._settings_without_depth = settings
        if self._learned:
            self.longest_s = max(self.longest_s, self._learned.lags_s[-1])
        poses = database.poses.reshape(database.frames, -1)
        self._broad_frames = np.arange(0, len(poses), max(1, len(poses) // _BROAD_SAMPLES))
        self._broad_poses = poses[self._broad_frames].astype(np.float64)
        earlier = LaggedFrames(database, settings.history_s)
        self.earlier_markers = LaggedMarkers(database, markers, earlier)
        self._poses = LaggedPoses(database, principal_components(self._broad_poses, _COMPONENTS), earlier)
        margin = np.array([[-_LIMIT_MARGIN_RAD], [_LIMIT_MARGIN_RAD]])
        self._limits = np.percentile(self._broad_poses, _LIMIT_PERCENTILES, axis=0) + margin
        self._grant_covariances()

    def _grant_covariances(self) -> None:
        """Compute the covariance that is added to the neighbours', and those of a pose about the continued motion."""
        settings, history = self._settings, self._history_of(self._broad_frames)
        broad = np.asarray(np.cov(np.concatenate((self._broad_poses, *history), axis=1).T, ddof=0))
        floor = settings.broad_share * broad
        floor[np.diag_indices_from(broad)] += settings.pose_floor_rad**2
        self._floor = np.where(np.abs(floor) > _NONE, floor, 0.0).astype(np.float32)
        size = self._broad_poses.shape[1]
        shares = (settings.change_share, self._settings_without_depth.change_share)
        self._change, self._smaller_change = (
            share * broad[:size, :size] + settings.change_rad**2 * np.eye(size) for share in shares
        )

    def backwards(self) -> "BestMethod":
        """Return a time-reversed copy."""
        found = copy(self)
        found.earlier_markers, found._poses = self.earlier_markers.backwards(), self._poses.backwards()
        found._grant_covariances()
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
        settings, covariance, limits = self._settings, self._smaller_change, self._limits
        root_sigma, sigma_m = (settings.root_sigma_m, settings.root_sigma_rad), settings.marker_sigma_m
        fitted, rotations, places = poses.copy(), roots.rotation.copy(), roots.position_m.copy()
        for index, observation in enumerate(observations):
            root, prior = RootPose(rotations[index], places[index]), Prior(poses[index], covariance)
            expectation = Expectation(prior, observation, root, root_sigma, limits)
            fitted[index], root, _ = gaussian_conditioning.fit_to_markers(
                expectation, self._subject, sigma_m, _FIT_STEPS
            )
            rotations[index], places[index] = root.rotation, root.position_m
        return fitted, RootPose(rotations, places)

    def estimate(self, problem: FrameProblem) -> Estimate:
        """Return the pose and the root that fit the markers under the prior."""
        # with rays only, the depth of a known body is a guess, so the settings for other bodies are used
        state, known = problem.state, self._known and bool(problem.observation.located.any())
        settings = self._settings if known else self._settings_without_depth
        closest, neighbours = self._prior(problem)
        prior = closest
        root, root_sigma = problem.root, (settings.root_sigma_m, settings.root_sigma_rad)
        learned, inflation = None, 0.0
        if self._learned:
            learned = state.learned
            if learned is None:
                seen = problem.observation
                if state.markers_m is not None:
                    seen = seen.back_projected(state.markers_m)
                learned = self._learned.estimate(self._learned.recent(seen, state.observed, state.time_s), root)
            vague = any(own > _VAGUE * other for own, other in zip(learned.root_sigma, root_sigma, strict=True))
            if not (self._known or vague):  # the torso markers of a known body give a better root
                root, root_sigma = learned.root, learned.root_sigma
        priors = [prior, learned.pose] if learned else [prior]
        off, *learned_off = deviations(priors, problem.observation, root, root_sigma, self._subject)
        widening = max(1.0, (off / _USUAL_DEVIATION) ** 2) if known else 1.0
        if learned:
            inflation = _inflation(off, learned_off[0], known)
            if known:
                prior = Prior(prior.mean, max(widening, inflation) * prior.covariance)
            else:
                hidden = self._subject.hidden_joints(problem.observation.seen)
                inflations = np.where(hidden, _inflation(off, max(learned_off[0], _LEAST_OFF)), inflation)
                prior = widen_joints(prior, learned.pose, inflations, _JOINT_INFLATION_SHARE)
            share = settings.prior_share * min(inflation, 1.0)
            prior = continue_prior(prior, learned.pose.mean, learned.pose.covariance / share)
        else:
            prior = Prior(prior.mean, widening * prior.covariance)
        if state.pose is not None and state.previous_pose is not None:
            expected = state.pose + settings.momentum * (state.pose - state.previous_pose)
            prior = continue_prior(prior, expected, self._change if known else self._smaller_change)
        expectation = Expectation(prior, problem.observation, root, root_sigma, self._limits)
        pose, root, steps = gaussian_conditioning.fit_to_markers(
            expectation, self._subject, settings.marker_sigma_m, _FIT_STEPS
        )
        uncertainty = _uncertainty(pose, closest, learned.pose if learned else None)
        uncertainty *= _KNOWN_SHARE if known else 1.0
        return Estimate(pose, root, neighbours, 0, steps, expectation, uncertainty, inflation > 1.0)

    def _prior(self, problem: FrameProblem) -> tuple[Prior, int]:
        """Return the Gaussian of the pose given the past, and the number of neighbours used."""
        settings, state, examples = self._settings, problem.state, problem.examples
        observed = self.earlier_markers.observed(state.observed, state.time_s, problem.root).ravel()
        solved = self._poses.observed(state.solved, state.time_s).ravel()
        sigmas = (settings.history_sigma_m, settings.history_sigma_rad)
        variances = np.repeat(np.square(sigmas), (len(observed), len(solved)))
        neighbours = Neighbours(examples.distances, examples.poses, *self._history_of(examples.frames))
        past, share = np.concatenate((observed, solved)), self._query_alpha * _HISTORY_SHARE
        return neighbours_prior(neighbours, share, past, variances, self._floor), len(examples.frames)

    def _history_of(self, frames: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the markers and the poses before database frames (K,), each as rows (K, ...)."""
        count = len(frames)
        markers, poses = self.earlier_markers.of_frames(frames), self._poses.of_frames(frames)
        return markers.reshape(count, -1), poses.reshape(count, -1)


def _inflation(off: float, learned_off: float, known: bool = False) -> float:
    """Return the factor of the neighbours' variances; instead of one below 1, its inverse inflates the learned prior's.

    Args:
        off: RMS distance of the markers from the neighbours' Gaussian, in standard deviations.
        learned_off: The same for the learned prior.
        known: Whether the body is in the database.
    """
    # if no markers are visible, the weights stay equal
    ratio = off / (learned_off * (_TRUSTED_KNOWN if known else _TRUSTED)) if learned_off else 1.0
    if not known:  # neighbours that explain the markers within a standard deviation keep their weight
        ratio *= min(1.0, off)
    return min(max(ratio**4, 1.0 / _MOST_INFLATION), _MOST_INFLATION)


def _uncertainty(pose: Array, closest: Prior, learned: Prior | None) -> Array:
    """Return the uncertainty (J - 1,) of joints, radians, up to a scale for each joint.

    It is the RMS of the learned prior's standard deviation and of the pose's distances from both priors' means. So it
    is large where the learned prior knows little, and where the two priors, or priors and markers, disagree. Without a
    learned prior, the neighbours stand for both.
    """
    vague = learned or closest
    squares = vague.covariance.diagonal() + np.square(pose - vague.mean) + np.square(pose - closest.mean)
    uncertainty = np.sqrt(np.add.reduce(squares.reshape(-1, 3), axis=1) / 3.0)
    return np.asarray(uncertainty if learned else _ALONE * uncertainty)
