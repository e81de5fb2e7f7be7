"""A frame's pose by the method "best": all its priors joined and fitted to the markers."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from ..kernel.library import Packed, address, checked, function, stage
from . import gaussian_conditioning
from .gaussian_conditioning import Expectation, Prior, continue_prior, deviations, widen_joints
from .lagged_history import LaggedMarkers, LaggedPoses
from .method import FrameProblem
from .motion_prior import PriorEstimate
from .neighbours_prior import PANEL, TINY, WIDTH, Neighbours, neighbours_prior
from .settings import BestSettings
from .solution import Estimate
from .subject_model import RootPose, SubjectModel

FIT_STEPS = 8  # largest number of Gauss-Newton steps; one is usually enough
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


@dataclass(frozen=True)
class BestModel:
    """What the method knows before the first frame."""

    subject: SubjectModel
    is_known: bool  # whether the body is in the database
    settings: BestSettings
    history_share: float  # weight of the squared distances of earlier markers relative to those of the search
    earlier_markers: LaggedMarkers
    earlier_poses: LaggedPoses
    floor: FloatArray  # (N, N) covariance that is added to the neighbours'
    change: Array  # (D, D) covariance of a pose about the continued motion
    limits: Array  # (2, D) smallest and largest values of a pose's entries, rad

    def closest_prior(self, problem: FrameProblem) -> Prior:
        """Return the Gaussian of the neighbours' poses given the past."""
        settings, state, examples = self.settings, problem.state, problem.examples
        observed = self.earlier_markers.observed(state.observed, state.time_s, problem.root).ravel()
        solved = self.earlier_poses.observed(state.solved, state.time_s).ravel()
        sigmas = (settings.history_sigma_m, settings.history_sigma_rad)
        variances = np.repeat(np.square(sigmas), (len(observed), len(solved)))
        history = history_of(self.earlier_markers, self.earlier_poses, examples.frames)
        past = np.concatenate((observed, solved))
        neighbours = Neighbours(examples.distances, examples.poses, *history)
        return neighbours_prior(neighbours, self.history_share, past, variances, self.floor)

    @cached_property
    def packed(self) -> Packed:
        """This model as the kernel takes it."""
        settings = self.settings
        bodies = self.subject.body.packed(), self.earlier_markers.packed(), self.earlier_poses.packed()
        numbers = (
            self.history_share, settings.history_sigma_m, settings.history_sigma_rad,
            settings.root_sigma_m, settings.root_sigma_rad, settings.marker_sigma_m, settings.prior_share,
            settings.momentum, _TRUSTED_KNOWN if self.is_known else _TRUSTED, _KNOWN_SHARE if self.is_known else 1.0,
        )  # fmt: skip
        return Packed(*bodies, self.floor, self.change, self.limits, self.is_known, *map(float, numbers))


CONSTANTS = Packed(
    WIDTH, float(TINY), gaussian_conditioning.EXPECTED_SIGMA_M, _VAGUE, _MOST_INFLATION, _USUAL_DEVIATION,
    _JOINT_INFLATION_SHARE, _LEAST_OFF, _ALONE, *gaussian_conditioning.FIT_SETTINGS, FIT_STEPS,
)  # fmt: skip
_ESTIMATE = function("estimate", "ppppppppppppp")


def _compiled(model: BestModel, problem: FrameProblem, learned: PriorEstimate | None) -> Estimate:
    state, examples, controls = problem.state, problem.examples, problem.observation.controls
    size, count, rows = examples.poses.shape[1], len(examples.frames), len(controls.markers)
    observed = model.earlier_markers.recent(state.observed, state.time_s)
    solved = model.earlier_poses.recent(state.solved, state.time_s)
    place = np.concatenate((problem.root.rotation, problem.root.position_m))
    followed = (state.pose, state.previous_pose) if state.previous_pose is not None else (None, None)
    given: tuple[Array | Mask | None, ...] = (None,) * 5
    if learned:
        expected = np.concatenate((learned.root.rotation, learned.root.position_m))
        hidden = model.subject.hidden_joints(problem.observation.seen)
        given = (*learned.pose, expected, np.array(learned.root_sigma), np.ascontiguousarray(hidden))
    frame = Packed(
        count, np.ascontiguousarray(examples.frames, dtype=np.int64),
        np.ascontiguousarray(examples.distances, dtype=np.float64), np.ascontiguousarray(examples.poses),
        observed, solved, place, *followed, rows, controls.markers, np.ascontiguousarray(controls.axes),
        np.ascontiguousarray(controls.origins_m), controls.noise_m, *given,
    )  # fmt: skip
    mean, covariance, prior_root = np.empty(size), np.empty((size, size)), np.empty(9)
    pose, fitted, uncertainty = np.empty(size), np.empty(7), np.empty(size // 3)
    numbers, steps = np.empty(2), np.empty(1, dtype=np.int64)
    found: tuple[NDArray[Any], ...] = mean, covariance, prior_root, pose, fitted, uncertainty, numbers, steps
    memory = map(address, (*work_for(model, count, rows, size), *found))
    checked(_ESTIMATE(model.packed.address, CONSTANTS.address, frame.address, *memory))
    root_sigma = (float(prior_root[7]), float(prior_root[8]))
    root = RootPose(prior_root[:4], prior_root[4:7])
    expectation = Expectation(Prior(mean, covariance), problem.observation, root, root_sigma, model.limits)
    inflation, tilt_rad = numbers.tolist()
    fit = pose, RootPose(fitted[:4], fitted[4:])
    return Estimate(*fit, count, 0, int(steps[0]), expectation, uncertainty, inflation > 1.0, tilt_rad)


def work_for(model: BestModel, count: int, rows: int, size: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return memory for the kernel, for `count` examples and `rows` controls: double and single precision."""
    whole, markers, width, most = len(model.floor), 3 * len(model.subject.joints), 6 + size, rows + size
    of_history = 2 * (whole - size) + count * len(model.earlier_markers.lags_s) + whole
    of_prior = of_history + count + (whole + 1) * (whole + 4)
    of_deviation = 2 * rows + markers * (1 + width) + rows * (2 * width + rows + 4)
    of_continuing = 2 * size * (2 * size + 4)
    of_fit = rows + markers * (1 + width) + most * (3 * width + 2 * most + 7) + 4 * width + 2 * size
    doubles = 2 * size + 3 * size * size + max(of_prior, of_deviation, of_continuing, of_fit)
    singles = count * (whole - size) + (whole + PANEL) * count
    return np.empty(doubles), np.empty(singles, dtype=np.float32)


@stage(_compiled)
def best_estimate(model: BestModel, problem: FrameProblem, learned: PriorEstimate | None) -> Estimate:
    """Return the pose and the root that fit the markers under the priors of neighbours, motion and training.

    Args:
        learned: Learned prior for the frame; None to do without.
    """
    state, settings, known = problem.state, model.settings, model.is_known
    closest = model.closest_prior(problem)
    prior = closest
    root, root_sigma = problem.root, (settings.root_sigma_m, settings.root_sigma_rad)
    inflation = 0.0
    if learned:
        vague = any(own > _VAGUE * other for own, other in zip(learned.root_sigma, root_sigma, strict=True))
        if not (known or vague):  # the torso markers of a known body give a better root
            root, root_sigma = learned.root, learned.root_sigma
    priors = [prior, learned.pose] if learned else [prior]
    off, *learned_off = deviations(priors, problem.observation, root, root_sigma, model.subject)
    widening = max(1.0, (off / _USUAL_DEVIATION) ** 2) if known else 1.0
    if learned:
        inflation = _inflation(off, learned_off[0], known)
        if known:
            prior = Prior(prior.mean, max(widening, inflation) * prior.covariance)
        else:
            hidden = model.subject.hidden_joints(problem.observation.seen)
            inflations = np.where(hidden, _inflation(off, max(learned_off[0], _LEAST_OFF)), inflation)
            prior = widen_joints(prior, learned.pose, inflations, _JOINT_INFLATION_SHARE)
        share = settings.prior_share * min(inflation, 1.0)
        prior = continue_prior(prior, learned.pose.mean, learned.pose.covariance / share)
    else:
        prior = Prior(prior.mean, widening * prior.covariance)
    if state.pose is not None and state.previous_pose is not None:
        expected = state.pose + settings.momentum * (state.pose - state.previous_pose)
        prior = continue_prior(prior, expected, model.change)
    expectation = Expectation(prior, problem.observation, root, root_sigma, model.limits)
    pose, root, steps = gaussian_conditioning.fit_to_markers(
        expectation, model.subject, settings.marker_sigma_m, FIT_STEPS
    )
    uncertainty = _uncertainty(pose, closest, learned.pose if learned else None)
    uncertainty *= _KNOWN_SHARE if known else 1.0
    tilt_rad, led = model.earlier_markers.tilt_rad(root, problem.examples.frames), inflation > 1.0
    return Estimate(pose, root, len(problem.examples.frames), 0, steps, expectation, uncertainty, led, tilt_rad)


def history_of(markers: LaggedMarkers, poses: LaggedPoses, frames: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the markers and the poses before database frames (K,), each as rows (K, ...)."""
    count = len(frames)
    return markers.of_frames(frames).reshape(count, -1), poses.of_frames(frames).reshape(count, -1)


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
