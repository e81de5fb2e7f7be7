"""Smoothing of poses by their neighbours in time: a filter with five Gaussian taps, delayed by two frames.

A pose that is shown two frames later than solved can be averaged with the two poses before and the two after. This
removes the jitter caused by noise and flickering markers at no cost in accuracy, because a centred mean does not lag.
The noisier the source, the wider the weights: `SourceNoise.shown_s`.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.clock import PAUSE_S
from ..body.scene_pose import PerformerPose, ScenePose
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..markers.source_noise import SourceNoise


@dataclass(frozen=True)
class TapSettings:
    """Settings of the filter."""

    frames: int = 2  # number of frames averaged on either side; also the delay
    cut_m: float = 0.3  # movement of the root between two frames above which there is a cut


_S = TapSettings()


class DelayedPoses:
    """Smooths the poses of a capture one after another.

    Args:
        source: Errors of the points from which the poses were solved.
    """

    def __init__(self, source: SourceNoise) -> None:
        self._source = source
        self._window: deque[ScenePose] = deque(maxlen=2 * _S.frames + 1)

    def step(self, pose: ScenePose) -> ScenePose | None:
        """Add a pose, and return that of two frames earlier, smoothed; None for the first two frames."""
        self._window.append(pose)
        at = len(self._window) - 1 - _S.frames
        return _scene_calmed(self._window, at, self._source) if at >= 0 else None

    def rest(self) -> list[ScenePose]:
        """Return the poses not yet returned; at the end they are smoothed with fewer later ones."""
        first = max(len(self._window) - _S.frames, 0)
        return [_scene_calmed(self._window, index, self._source) for index in range(first, len(self._window))]


def calm_poses(poses: Sequence[ScenePose], source: SourceNoise) -> list[ScenePose]:
    """Return all poses of a take, each smoothed by its neighbours in time."""
    columns = [calm_performer(column, source) for column in zip(*(pose.performers for pose in poses), strict=True)]
    return [replace(pose, performers=row) for pose, row in zip(poses, zip(*columns, strict=True), strict=True)]


def calm_performer(poses: Sequence[PerformerPose], source: SourceNoise) -> list[PerformerPose]:
    """Return all poses of one performer, each smoothed by its neighbours in time."""
    return [_calmed(poses, at, source) for at in range(len(poses))]


def _scene_calmed(poses: Sequence[ScenePose], at: int, source: SourceNoise) -> ScenePose:
    columns = zip(*(pose.performers for pose in poses), strict=True)
    return replace(poses[at], performers=tuple(_calmed(column, at, source) for column in columns))


def _calmed(poses: Sequence[PerformerPose], at: int, source: SourceNoise) -> PerformerPose:
    """Return a pose averaged with those of its neighbours that belong to the same motion."""
    first, last = at, at
    while first > max(at - _S.frames, 0) and _goes_on(poses[first - 1], poses[first]):
        first -= 1
    while last < min(at + _S.frames, len(poses) - 1) and _goes_on(poses[last], poses[last + 1]):
        last += 1
    return _mean(poses[first : last + 1], poses[at], source.shown_s) if last > first else poses[at]


def _goes_on(before: PerformerPose, pose: PerformerPose) -> bool:
    if not (np.isfinite(before.marker_rms_m) and np.isfinite(pose.marker_rms_m)):
        return False  # one of the two was not solved
    moved_m = np.linalg.norm(pose.root_position_m - before.root_position_m)
    return 0.0 < pose.time_s - before.time_s < PAUSE_S and bool(moved_m < _S.cut_m)


def _mean(poses: Sequence[PerformerPose], shown: PerformerPose, sigma_s: float) -> PerformerPose:
    """Return the pose `shown` moved onto a line through all poses, fitted with weights that fall with time."""
    weights = _weights(np.array([pose.time_s for pose in poses]) - shown.time_s, sigma_s)
    turns = np.array([pose.rotations for pose in poses])
    away = rot.to_rotation_vector(rot.multiply(rot.conjugate(shown.rotations), turns))
    rotations = rot.multiply(shown.rotations, rot.from_rotation_vector(np.tensordot(weights, away, 1)))
    roots_m = np.array([pose.root_position_m for pose in poses])
    return replace(shown, rotations=rotations, root_position_m=weights @ roots_m)


def _weights(elapsed_s: Array, sigma_s: float) -> Array:
    """Return the weights (N,) of the poses in the value of the fitted line at time 0."""
    weights = np.exp(-0.5 * (elapsed_s / sigma_s) ** 2)
    mass, moment, spread = (float(weights @ elapsed_s**power) for power in range(3))
    return np.asarray(weights * (spread - moment * elapsed_s) / (mass * spread - moment**2))
