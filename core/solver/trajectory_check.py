"""Whether other parts of the database follow the markers better than the present.

Examples are searched near the motion so far, so a wrong start can lead on for seconds where all markers are explained.
Now and then the markers of the last moments are compared with a sample of the whole database: on a right course few
frames are nearer than the present examples, on a wrong one some always are.
"""

from copy import copy

import numpy as np

from ..geometry.arrays import Array, IntArray
from .database_markers import DatabaseMarkers
from .lagged_history import LaggedMarkers
from .observation import Observation
from .search.exhaustive import Query
from .search.sample import SampleSearch
from .solution import SolverState
from .subject_model import RootPose

INTERVAL_S = 0.1  # between two comparisons
PROVEN = 0.5  # evidence above which another course is the right one
_USUAL = 0.85  # distance of the nearest frame of all, as a share of the nearest example's, on a right course
_NEAREST = 24  # frames of the sample that are compared with their neighbours in time,
_PER_SAMPLE = 16  # with so many of each at first, and with all that are beside
_BESIDE = 8  # of the nearest
_EXAMPLES = 64


class TrajectoryCheck:
    """Compares the present examples with the whole database.

    Args:
        sample: of the database.
        earlier: markers before these.
    """

    def __init__(self, sample: SampleSearch, markers: DatabaseMarkers, earlier: LaggedMarkers) -> None:
        self._sample, self._markers, self._earlier = sample, markers, earlier
        # frames that follow each other are alike: those between some are looked at only where these are near
        self._apart = max(1, sample.step // _PER_SAMPLE)

    def backwards(self) -> "TrajectoryCheck":
        """Return the same for time that runs backwards."""
        found = copy(self)
        found._earlier = self._earlier.backwards()
        return found

    def evidence(self, state: SolverState, observation: Observation, root: RootPose, examples: IntArray) -> float:
        """Return the evidence against the present course after one more comparison.

        Args:
            state: before the frame, with its time.
            root: solved.
            examples: (K,) frames near the motion so far, nearest first.
        """
        query = Query(root.to_root_frame(observation.points_m), None, 1.0, 0.0)
        free = self._sample.around(self._sample.nearest(query, _NEAREST), apart=self._apart)
        distances = self._distances(state, observation, root, np.concatenate((free, examples[:_EXAMPLES])))
        nearest, of_examples = (part.min(axis=1) for part in (distances[:, : len(free)], distances[:, len(free) :]))
        if self._apart > 1 and len(free) > _BESIDE:
            best = np.unique(np.argpartition(distances[:, : len(free)], _BESIDE, axis=1)[:, :_BESIDE])
            beside = free[best, None] + np.concatenate((np.arange(1 - self._apart, 0), np.arange(1, self._apart)))
            beside = np.clip(beside.ravel(), 0, len(self._markers) - 1)
            nearest = np.minimum(nearest, self._distances(state, observation, root, beside).min(axis=1))
        share = np.prod(nearest / of_examples) ** 0.25
        return max(state.evidence + float(np.log(_USUAL / share)), 0.0)

    def _distances(self, state: SolverState, observation: Observation, root: RootPose, frames: IntArray) -> Array:
        """Return squared distances (2, K), m^2, of markers, now and earlier, to frames.

        The second row compares earlier markers about their mean: on a treadmill a body stays where it is.
        """
        seen = observation.located
        now = root.to_root_frame(observation.points_m[seen])
        away = np.tile(_squares(self._markers.take(frames)[:, seen] - now), (2, 1))
        earlier = self._earlier.observed(state.observed, state.time_s, root)
        for observed, known in zip(earlier, np.moveaxis(self._earlier.of_frames(frames), 1, 0), strict=True):
            seen = np.isfinite(observed[:, 0])
            if seen.any():
                apart = known[:, seen] - observed[seen]
                away[0] += _squares(apart)
                away[1] += _squares(apart - np.add.reduce(apart, axis=1, keepdims=True) / apart.shape[1])
        return np.asarray(np.maximum(away, 1e-12))


def _squares(differences: Array) -> Array:
    """Return the sums of squares (K,) of differences (K, M, 3)."""
    return np.einsum("kmc,kmc->k", differences, differences)
