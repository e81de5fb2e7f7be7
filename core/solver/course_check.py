"""Whether other parts of the database follow the markers better than the present.

Examples are searched near the motion so far, so a wrong start can lead on for seconds where all markers are explained.
Now and then the markers of the last moments are compared with a sample of the whole database: on a right course few
frames are nearer than the present examples, on a wrong one some always are.
"""

from copy import copy

import numpy as np

from ..database.store import Database
from ..geometry.arrays import Array, FloatArray, IntArray
from .lagged_history import LaggedMarkers
from .observation import Observation
from .search.exhaustive import Query
from .search.sample import SampleSearch
from .solution import SolverState
from .subject_model import RootPose

INTERVAL_S = 0.1  # between two comparisons
PROVEN = 0.5  # evidence above which another course is the right one
_USUAL = 0.85  # distance of the nearest frame of all, as a share of the nearest example's, on a right course
_NEAREST = 24  # frames of the sample that are compared with their neighbours in time
_EXAMPLES = 64


class CourseCheck:
    """Compares the present examples with the whole database.

    Args:
        markers_m: (F, M, 3) the subject's markers of the database frames with the root at rest.
        earlier: markers before these.
    """

    def __init__(self, database: Database, markers_m: FloatArray, earlier: LaggedMarkers) -> None:
        self._markers = markers_m
        self._sample = SampleSearch(markers_m, database.poses.reshape(database.frames, -1))
        self._earlier = earlier

    def backwards(self) -> "CourseCheck":
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
        free = self._sample.around(self._sample.nearest(query, _NEAREST))
        distances = self._distances(state, observation, root, np.concatenate((free, examples[:_EXAMPLES])))
        nearest = [part.min(axis=1) for part in (distances[:, : len(free)], distances[:, len(free) :])]
        share = np.prod(nearest[0] / nearest[1]) ** 0.25
        return max(state.evidence + float(np.log(_USUAL / share)), 0.0)

    def _distances(self, state: SolverState, observation: Observation, root: RootPose, frames: IntArray) -> Array:
        """Return squared distances (2, K), m^2, of markers, now and earlier, to frames.

        The second row compares earlier markers about their mean: on a treadmill a body stays where it is.
        """
        seen = observation.located
        now = root.to_root_frame(observation.points_m[seen])
        away = np.tile(_squares(self._markers.take(frames, axis=0)[:, seen] - now), (2, 1))
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
