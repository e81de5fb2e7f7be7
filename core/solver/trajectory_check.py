"""Check of whether other parts of the database explain the recent markers better than the current examples.

Examples are searched near the motion so far, so a wrong start can persist for seconds even if all markers are
explained. From time to time the recent markers are compared with a sample of the whole database. On a correct
trajectory, frames are rarely nearer than the current examples; on a wrong one, some always are.
"""

from copy import copy

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from ..kernel.library import address, checked, contiguous, function, stage
from .database_markers import DatabaseMarkers
from .lagged_history import LaggedMarkers
from .observation import Observation
from .search.exhaustive import Query
from .search.sample import SampleSearch
from .solution import SolverState
from .subject_model import RootPose

INTERVAL_S = 0.1  # time between two comparisons
PROVEN = 0.5  # evidence above which the current trajectory is abandoned, nats
_USUAL = 0.85  # typical distance of the nearest frame relative to the nearest example's, on a correct trajectory
_NEAREST = 24  # number of sample frames that are compared together with their neighbours in time
_PER_SAMPLE = 16  # number of evenly spaced neighbours of each compared at first; all are around the nearest
_BESIDE = 8  # number of nearest frames around which all frames are compared
_EXAMPLES = 64  # number of current examples that are compared


class TrajectoryCheck:
    """Compares the current examples with a sample of the whole database.

    Attributes:
        packed: The earlier markers as the kernel takes them.
    """

    def __init__(self, sample: SampleSearch, markers: DatabaseMarkers, earlier: LaggedMarkers) -> None:
        self._sample, self._markers, self._earlier = sample, markers, earlier
        self.packed = earlier.packed()
        # successive frames are alike, so all of them are compared only where some are near
        self._apart = max(1, sample.step // _PER_SAMPLE)

    def backwards(self) -> "TrajectoryCheck":
        """Return a time-reversed copy."""
        found = copy(self)
        found._earlier = self._earlier.backwards()
        found.packed = found._earlier.packed()
        return found

    def evidence(self, state: SolverState, observation: Observation, root: RootPose, examples: IntArray) -> float:
        """Return the evidence against the current trajectory after one more comparison.

        Args:
            state: State before the frame, with the frame's time.
            root: Solved root.
            examples: Database frames (K,) near the motion so far, nearest first.
        """
        now_m = root.to_root_frame(observation.points_m)
        before_m = self._earlier.observed(state.observed, state.time_s, root)
        free = self._sample.around(self._sample.nearest(Query(now_m, None, 1.0, 0.0), _NEAREST), apart=self._apart)
        distances = trajectory_distances(self, now_m, before_m, np.concatenate((free, examples[:_EXAMPLES])))
        nearest, of_examples = (part.min(axis=1) for part in (distances[:, : len(free)], distances[:, len(free) :]))
        if self._apart > 1 and len(free) > _BESIDE:
            best = np.unique(np.argpartition(distances[:, : len(free)], _BESIDE, axis=1)[:, :_BESIDE])
            beside = free[best, None] + np.concatenate((np.arange(1 - self._apart, 0), np.arange(1, self._apart)))
            beside = np.clip(beside.ravel(), 0, len(self._markers) - 1)
            nearest = np.minimum(nearest, trajectory_distances(self, now_m, before_m, beside).min(axis=1))
        share = np.prod(nearest / of_examples) ** 0.25
        return max(state.evidence + float(np.log(_USUAL / share)), 0.0)


_DISTANCES = function("trajectory_distances", "pppnppppp")


def _compiled(check: TrajectoryCheck, now_m: Array, before_m: Array, frames: IntArray) -> Array:
    lags, count, _ = before_m.shape
    found, earlier = np.empty((2, len(frames))), np.empty(lags * len(frames), dtype=np.int64)
    work = address(earlier), address(np.empty(3 * count, dtype=np.float32)), address(np.empty(3 * count))
    wanted = contiguous(now_m), contiguous(before_m), len(frames), contiguous(frames, np.int64)
    checked(_DISTANCES(check.packed.address, *wanted, *work, address(found)))
    return found


@stage(_compiled)
def trajectory_distances(check: TrajectoryCheck, now_m: Array, before_m: Array, frames: IntArray) -> Array:
    """Return the squared distances (2, K), m^2, of current and earlier markers from database frames (K,).

    In the second row, earlier markers are compared relative to their mean, for bodies on a treadmill.

    Args:
        now_m: Current markers (M, 3) in the root's frame, NaN where not located.
        before_m: Earlier markers (L, M, 3) in the same frame.
    """
    seen = _located(now_m)
    away = np.tile(_squares(check._markers.take(frames)[:, seen] - now_m[seen]), (2, 1))
    for observed, known in zip(before_m, np.moveaxis(check._earlier.of_frames(frames), 1, 0), strict=True):
        seen = _located(observed)
        if seen.any():
            apart = known[:, seen] - observed[seen]
            away[0] += _squares(apart)
            away[1] += _squares(apart - np.add.reduce(apart, axis=1, keepdims=True) / apart.shape[1])
    return np.asarray(np.maximum(away, 1e-12))


def _located(points_m: Array) -> Mask:
    """Return the mask (M,) of points (M, 3) that are located."""
    return np.asarray(np.logical_and.reduce(np.isfinite(points_m), axis=1))


def _squares(differences: Array) -> Array:
    """Return the sums of squares (K,) of differences (K, M, 3)."""
    return np.einsum("kmc,kmc->k", differences, differences)
