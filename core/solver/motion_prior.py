"""Learned prior: a Gaussian of pose and root, given the markers of the last half second.

A small network, trained by `tools/train_prior.py` on recorded motion with random bodies and marker sets. Each marker
passes through one layer with its joint's weights; the results are summed over each part of the body; three layers
follow. All inputs are relative to a body frame that is fitted to the torso markers, so position and heading do not
matter.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.standard_skeleton import JOINT_NAMES
from ..errors import FormatError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from ..geometry.npz import read_arrays
from ..kernel.library import Packed, address, checked, contiguous, function, stage
from ..system.files import reading
from .gaussian_conditioning import Prior
from .lagged_history import LaggedHistory
from .marker_kinematics import exponential_and_right_jacobian
from .observation import Observation
from .root import root_from_torso
from .subject_model import RootPose, SubjectModel

VERSION = 1
_OFFSET_SCALE = 10.0  # factor of offsets, to bring centimetres to the range of the other inputs (decimetres to metres)
_LAG_FLOOR_S = 0.03  # added to a lag by which movements are divided
_BY_ONE_CAMERA = 0.5  # input for a marker on a ray, whose depth is a guess, in place of 1 for a located one
_FASTEST_M_S = 12.0  # speed above which an earlier position is ignored: there was a cut, or the label changed
LOG_SIGMAS, FARTHEST = (-5.0, 2.0), 10.0  # limits of the scaled outputs' log standard deviations, and of their means
# factor of the weights in half precision as the kernel takes them, so that none is too small for a normal number
_HALF_SCALE, _MOST_HALF = 1024.0, 65504.0
_ROOT = 6  # number of outputs for the root: rotation, position
WEIGHTS = ("marker_weights", "marker_biases", "weights", "biases", "first_weights", "output_weights", "output_biases")


@dataclass(frozen=True)
class PriorEstimate:
    """Estimate of the learned prior: Gaussian of a pose, and the root with its standard deviations (m, rad)."""

    pose: Prior
    root: RootPose
    root_sigma: tuple[float, float]


@dataclass(frozen=True)
class Network:
    """A trained network: F features and H hidden units per marker, P body parts, W units per layer, O outputs."""

    lags_s: Array  # ascending lags of the markers; the first is 0
    mean_rotations: Array  # (J, 4) rotations to which its poses are relative
    part_of_joint: IntArray  # (J,) part of the body in which the markers of each joint are summed
    bones: FloatArray  # (2, J - 1) mean and scale of the bone lengths
    marker_weights: FloatArray  # (J, F, H)
    marker_biases: FloatArray  # (J, H)
    first_weights: FloatArray  # (P H + J - 1, W)
    weights: FloatArray  # (2, W, W)
    biases: FloatArray  # (3, W)
    output_weights: FloatArray  # (W, 2 O) outputs and their log standard deviations
    output_biases: FloatArray  # (2 O,)
    outputs: FloatArray  # (2, O) mean and scale of the outputs
    correlation: Array  # (O, O) of the errors for people who are not in the training data
    spread: Array  # (2, O) factors and smallest values of the standard deviations for such people
    facts: dict[str, Any]  # facts about its training


def open_network(path: Path) -> Network | None:
    """Return the network from a file; None if the file does not exist.

    Raises:
        FormatError: The file is damaged or of another version.
    """
    if not path.is_file():
        return None
    with reading(path, FormatError, "install the extension again", "is not a motion prior of this version"):
        arrays = read_arrays(path, what="is not a motion prior of this version")
        if any(arrays[name].dtype != np.float16 for name in WEIGHTS):
            raise ValueError("the weights are not in half precision")
        facts = json.loads(str(arrays.pop("facts")))
        for name in arrays:
            kind = np.int64 if name == "part_of_joint" else np.float32 if name in (*WEIGHTS, "bones") else np.float64
            arrays[name] = arrays[name].astype(kind)
        network = Network(**arrays, facts=facts)
        if facts["version"] != VERSION or not _fits(network):
            raise ValueError("wrong version, array shapes or numbers")
        return network


def _fits(network: Network) -> bool:
    """Return whether the arrays have matching shapes, and finite numbers that the kernel can take."""
    joints, lags, outputs = len(JOINT_NAMES), len(network.lags_s), _ROOT + 3 * (len(JOINT_NAMES) - 1)
    hidden, width = network.marker_biases.shape[-1], network.biases.shape[-1]
    parts = int(network.part_of_joint.max(initial=0)) + 1
    features = 9 + 3 * (lags - 1) + lags
    expected = {
        "lags_s": (lags,), "mean_rotations": (joints, 4), "part_of_joint": (joints,), "bones": (2, joints - 1),
        "marker_weights": (joints, features, hidden), "marker_biases": (joints, hidden),
        "first_weights": (parts * hidden + joints - 1, width), "weights": (2, width, width), "biases": (3, width),
        "output_weights": (width, 2 * outputs), "output_biases": (2 * outputs,), "outputs": (2, outputs),
        "correlation": (outputs, outputs), "spread": (2, outputs),
    }  # fmt: skip
    largest = max(float(np.max(np.abs(getattr(network, name)))) for name in WEIGHTS)
    return (
        bool(np.all(network.part_of_joint >= 0))
        and largest * _HALF_SCALE < _MOST_HALF
        and all(
            getattr(network, name).shape == shape and np.all(np.isfinite(getattr(network, name)))
            for name, shape in expected.items()
        )
    )


@dataclass(frozen=True)
class RecentMarkers:
    """Markers of the current frame and of earlier frames."""

    points_m: Array  # (L, M, 3) in the world at each lag, NaN where not located
    single: Mask  # (M,) markers seen by one camera: their current points are guesses along its rays


class MotionPrior:
    """A network prepared for one subject.

    Args:
        subject: Body, with the reference pose to which its poses are relative.
        common_reference_pose: Reference pose (J, 4) of the database; the network was trained with this one only.
    """

    def __init__(self, network: Network, subject: SubjectModel, common_reference_pose: Array) -> None:
        self._network = network
        turn = rot.multiply(rot.conjugate(common_reference_pose), subject.mean_rotations)
        self._body = SubjectModel(subject.subject, rot.multiply(network.mean_rotations, turn))
        joints = subject.joints
        self._offsets_m = rot.rotate(turn[joints], subject.offsets_m)
        # factors that convert the network's joint rotations to ones relative to the subject's reference pose
        self._back = rot.to_matrix(rot.conjugate(turn[1:]))
        before = rot.multiply(rot.conjugate(subject.mean_rotations), network.mean_rotations)[1:, None]
        self._change = rot.multiply(rot.multiply(before, np.eye(4)), turn[1:, None]).swapaxes(-1, -2)
        self._correlation = np.ascontiguousarray(network.correlation[_ROOT:, _ROOT:])
        self._rest = self._body.markers(np.zeros((len(subject.skeleton) - 1, 3)))
        self._weights, self._biases = network.marker_weights[joints], network.marker_biases[joints]
        lengths = np.linalg.norm(subject.skeleton.offsets_m[1:], axis=-1)
        bones = ((lengths - network.bones[0]) / network.bones[1]).astype(np.float32)
        parts, hidden = int(network.part_of_joint.max()) + 1, self._biases.shape[1]
        # parts without markers contribute nothing
        worn = np.unique(network.part_of_joint[joints])
        self._parts = (network.part_of_joint[joints] == worn[:, None]).astype(np.float32)
        rows = network.first_weights[: parts * hidden].reshape(parts, hidden, -1)[worn]
        self._first = rows.reshape(len(worn) * hidden, -1)
        self._first_bias = network.biases[0] + bones @ network.first_weights[parts * hidden :]

    @property
    def size(self) -> int:
        """Number D of entries of a pose."""
        return 3 * len(self._back)

    @property
    def lags_s(self) -> tuple[float, ...]:
        """Ascending lags of the markers, starting with 0."""
        return tuple(self._network.lags_s.tolist())

    def recent(self, observation: Observation, observed: LaggedHistory, time_s: float) -> RecentMarkers:
        """Return the markers of this frame and of earlier frames.

        Args:
            observation: Observation, in which single-camera markers are back-projected if they are to be used.
        """
        earlier_m = observed.recent(time_s, self.lags_s[1:], observation.points_m.shape)
        points_m = np.concatenate((observation.points_m[None], earlier_m))
        return RecentMarkers(points_m, observation.cameras >= 0)

    def estimate(self, recent: RecentMarkers, root: RootPose) -> PriorEstimate:
        """Return the estimate for current and earlier markers.

        Args:
            root: Root to use if too few torso markers are located.
        """
        return _one_estimate(self, recent, root)

    def in_numpy(self, recent: RecentMarkers, root: RootPose) -> PriorEstimate:
        """Return the same estimate, computed like those of many frames."""
        return self._estimates([recent], [self._frame(recent, root) or root])[0]

    @cached_property
    def packed(self) -> Packed:
        """This prior as the kernel takes it."""
        network, body = self._network, self._body
        (markers, features, hidden), (count, width) = self._weights.shape, self._first.shape
        parts, joints = np.argmax(self._parts, axis=0), len(self._back)
        sizes = len(network.lags_s), markers, joints, features, hidden, count // hidden, width, _ROOT + 3 * joints
        body_values = network.lags_s, body.torso_weights, self._rest, _OFFSET_SCALE * self._offsets_m, parts
        weights = self._weights, self._first, network.weights, network.output_weights
        halves = [(each * _HALF_SCALE).astype(np.float16) for each in weights]
        biases = self._biases, self._first_bias, network.biases[1:], network.output_biases
        moves = network.outputs, network.spread, self._change, self._back, self._correlation
        arrays = map(np.ascontiguousarray, (*body_values, *halves, *biases, *moves))
        limits = _LAG_FLOOR_S, _BY_ONE_CAMERA, _FASTEST_M_S, FARTHEST, *LOG_SIGMAS, 2.0**112 / _HALF_SCALE
        return Packed(*sizes, *arrays, *limits)

    def memory(self) -> tuple[Array, FloatArray]:
        """Return memory for the kernel: double and single precision."""
        (markers, features, hidden), (count, width) = self._weights.shape, self._first.shape
        outputs = len(self._network.outputs[0])
        doubles = markers * (3 * len(self.lags_s) + 7) + 11 * outputs
        return np.empty(doubles), np.empty(features + hidden + count + 2 * width + 2 * outputs, dtype=np.float32)

    def estimate_all(self, recent: Sequence[RecentMarkers]) -> list[PriorEstimate | None]:
        """Return the estimates for many frames, computed together; None where too few torso markers are located."""
        frames = [self._frame(each, None) for each in recent]
        known = [(each, frame) for each, frame in zip(recent, frames, strict=True) if frame]
        if not known:
            return [None] * len(frames)
        found = iter(self._estimates([each for each, _ in known], [frame for _, frame in known]))
        return [next(found) if frame else None for frame in frames]

    def _frame(self, recent: RecentMarkers, root: RootPose | None) -> RootPose | None:
        """Return the body frame fitted to the torso markers; if too few are located, `root` shifted to all markers."""
        return root_from_torso(Observation.of_points(recent.points_m[0]), self._rest, self._body, root)

    def _estimates(self, recent: Sequence[RecentMarkers], frames: Sequence[RootPose]) -> list[PriorEstimate]:
        """Return the estimates for recent markers and the body frames fitted to them."""
        in_frames = np.array([frame.to_root_frame(each.points_m) for each, frame in zip(recent, frames, strict=True)])
        single = np.array([each.single for each in recent])
        rest = np.broadcast_to(self._rest, (len(frames), *self._rest.shape))
        features = marker_features(in_frames, single, rest, self._offsets_m, self._network.lags_s)
        # bounded inputs keep the outputs finite
        within = np.minimum(np.maximum(features, -_FASTEST_M_S), _FASTEST_M_S).astype(np.float32)
        means, sigmas = self._run(within, np.isfinite(in_frames[..., 0]).any(axis=1))
        turns = rot.multiply(np.array([frame.rotation for frame in frames]), rot.from_rotation_vector(means[:, :3]))
        poses = self._relative_to_subject(means[:, _ROOT:], sigmas[:, _ROOT:])
        result = []
        for frame, pose, turn, mean, sigma in zip(frames, poses, turns, means, sigmas, strict=True):
            turned, moved = sigma[:3], sigma[3:_ROOT]
            root_sigma = (math.sqrt(float(moved @ moved) / 3.0), math.sqrt(float(turned @ turned) / 3.0))
            result.append(PriorEstimate(pose, RootPose(turn, frame.to_world(mean[3:_ROOT])), root_sigma))
        return result

    def _run(self, features: FloatArray, seen: Mask) -> tuple[Array, Array]:
        """Return outputs (N, O) and standard deviations for features (N, M, F) and a mask (N, M) of visible markers."""
        network = self._network
        hidden = _silu(features.swapaxes(0, 1) @ self._weights + self._biases[:, None])
        hidden[~seen.T] = 0.0
        parts = (self._parts @ hidden.reshape(len(hidden), -1)).reshape(len(self._parts), len(features), -1)
        state = _silu(parts.swapaxes(0, 1).reshape(len(features), -1) @ self._first + self._first_bias)
        for weights, bias in zip(network.weights, network.biases[1:], strict=True):
            state = state + _silu(state @ weights + bias)
        outputs = state @ network.output_weights + network.output_biases
        count = outputs.shape[1] // 2
        mean = np.minimum(np.maximum(outputs[:, :count], -FARTHEST), FARTHEST)
        log_sigma = np.minimum(np.maximum(outputs[:, count:], LOG_SIGMAS[0]), LOG_SIGMAS[1])
        offset, scale = network.outputs
        sigma = np.hypot(network.spread[0] * scale * np.exp(log_sigma.astype(np.float64)), network.spread[1])
        return offset + scale * mean.astype(np.float64), sigma

    def _relative_to_subject(self, poses: Array, sigmas: Array) -> list[Prior]:
        """Return the network's Gaussians, means and sigmas (N, D), relative to the subject's reference pose."""
        moved = moved_gaussians(poses, sigmas, self._change, self._back, self._correlation)
        return [Prior(*pair) for pair in zip(*moved, strict=True)]


_ONE = function("learned_prior", "ppppppppp")


def _compiled_one(prior: MotionPrior, recent: RecentMarkers, root: RootPose) -> PriorEstimate:
    size = prior.size
    mean, covariance, sigmas = np.empty(size), np.empty((size, size)), np.empty(2)
    place = np.concatenate((root.rotation, root.position_m))
    arrays: tuple[NDArray[Any], ...] = (*prior.memory(), mean, covariance, place, sigmas)
    given = contiguous(recent.points_m), contiguous(recent.single, np.bool_)
    checked(_ONE(prior.packed.address, *given, *map(address, arrays)))
    return PriorEstimate(Prior(mean, covariance), RootPose(place[:4], place[4:]), (float(sigmas[0]), float(sigmas[1])))


@stage(_compiled_one)
def _one_estimate(prior: MotionPrior, recent: RecentMarkers, root: RootPose) -> PriorEstimate:
    return prior.in_numpy(recent, root)


_MOVED = function("moved_gaussians", "nnpppppppp")


def _compiled(means: Array, sigmas: Array, change: Array, back: Array, correlation: Array) -> tuple[Array, Array]:
    count, size = means.shape
    moved, covariances, slopes = np.empty(means.shape), np.empty((count, size, size)), np.empty(3 * size)
    kept = map(contiguous, (means, sigmas, change, back, correlation))
    checked(_MOVED(count, size // 3, *kept, address(slopes), address(moved), address(covariances)))
    return moved, covariances


@stage(_compiled)
def moved_gaussians(means: Array, sigmas: Array, change: Array, back: Array, correlation: Array) -> tuple[Array, Array]:
    """Return means (N, D) and covariances (N, D, D) of rotation vectors relative to other reference rotations.

    Args:
        means: Rotation vectors (N, D).
        sigmas: Their standard deviations (N, D).
        change: Matrices (J - 1, 4, 4) that turn their quaternions.
        back: Matrices (J - 1, 3, 3) that turn their small rotations.
        correlation: Correlation (D, D) of their errors.
    """
    (count, size), joints = means.shape, len(back)
    vectors = means.reshape(count, joints, 3)
    moved = rot.to_rotation_vector((change @ rot.from_rotation_vector(vectors)[..., None])[..., 0])
    before, after = exponential_and_right_jacobian(np.array((vectors, moved)))[1]
    slopes = np.linalg.solve(after, back @ before) * sigmas.reshape(count, joints, 1, 3)
    half = slopes @ correlation.reshape(joints, 3, size)
    covariances = slopes @ half.reshape(count, size, size).swapaxes(1, 2).reshape(half.shape)
    return moved.reshape(means.shape), covariances.reshape(count, size, size)


def marker_features(points_m: Array, single: Mask, rest_m: Array, offsets_m: Array, lags_s: Array) -> Array:
    """Return the network's inputs (..., M, F).

    Args:
        points_m: Markers (..., L, M, 3) at each lag in the body frame, NaN where not located.
        single: Mask (..., M) of markers that only one camera sees now.
        rest_m: Markers (..., M, 3) of the mean pose.
        offsets_m: Offsets (..., M, 3) of the markers in their joints' axes.
        lags_s: Lags (L,).
    """
    points = points_m.swapaxes(-3, -2)
    seen = np.isfinite(points[..., 0])
    latest = points[..., :1, :]
    if not seen[..., 0].all():
        latest = np.take_along_axis(points, np.argmax(seen, axis=-1)[..., None, None], axis=-2)
    moved = (points[..., 1:, :] - latest) / (_LAG_FLOOR_S + lags_s[1:, None])
    seen[..., 1:] &= np.add.reduce(moved * moved, axis=-1) < _FASTEST_M_S**2
    moved = np.where(seen[..., 1:, None], moved, 0.0)
    certain = seen.astype(points.dtype)
    certain[..., 0] *= np.where(single, _BY_ONE_CAMERA, 1.0)
    parts = (
        np.where(seen.any(axis=-1)[..., None], latest[..., 0, :] - rest_m, 0.0),
        np.broadcast_to(_OFFSET_SCALE * offsets_m, rest_m.shape),
        rest_m,
        moved.reshape(*moved.shape[:-2], -1),
        certain,
    )
    return np.concatenate(parts, axis=-1)


def _silu(x: FloatArray) -> FloatArray:
    return 0.5 * x * (1.0 + np.tanh(0.5 * x))  # the sigmoid in a form that cannot overflow
