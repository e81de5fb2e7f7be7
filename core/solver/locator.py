"""Search for the root and the closest database examples that fit a frame's markers."""

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..database.store import Database
from ..geometry.arrays import Array, IntArray
from ..kernel.library import Packed, address, checked, contiguous, function, stage
from .database_markers import DatabaseMarkers
from .method import Method
from .observation import Observation
from .root import root_from_torso
from .search.exhaustive import Query, Search
from .search.inverted_file import CellSearch
from .search.sample import SampleSearch
from .solution import Examples, SolverState
from .subject_model import ROOT_AT_REST, RootPose, SubjectModel

_ROOT_PASSES = 2  # number of alternations: the root depends on the pose's torso markers, the search on the root
_FIRST_ROOT_PASSES = 4  # number of alternations at the start, when both are unknown
_SAMPLE_PASSES = 3  # number of alternations with a sample of the database, which come first if time is short
_TORSO_EXAMPLES = 8  # number of closest examples to whose mean torso the root is fitted
_SPARE_CANDIDATES = 2  # number of candidates kept per example wanted, to be ranked again with a better root


class Located(NamedTuple):
    """Root, closest examples for this root, and frames from which the next search starts."""

    root: RootPose
    examples: Examples
    found: IntArray
    nearest_m: float  # RMS distance of the located markers from those of the closest example; NaN without any


class Locator:
    """Finds root and examples in alternation, each from the other.

    Args:
        search: Index over all database frames.
        sample: Index over a sample of frames, used if there is little time.
        query_alpha: Weight of the markers relative to continuity (Eq. 2).

    Attributes:
        search: The index over all frames.
        examples: Number of examples wanted.
    """

    def __init__(
        self,
        subject: SubjectModel,
        database: Database,
        markers: DatabaseMarkers,
        search: Search,
        sample: SampleSearch,
        method: Method,
        query_alpha: float,
    ) -> None:
        self._subject, self._markers, self._alpha = subject, markers, query_alpha
        self.search, self._sample = search, sample
        self.examples, self._pose_weight = method.examples, (1.0 - query_alpha) * method.query_pose_m_per_rad**2
        self._poses = np.asarray(database.poses).reshape(database.frames, -1)  # slices of a memmap are slow
        own = database.own_frames(subject.skeleton, subject.subject.name)
        self._factors: Array | None = None
        if method.others_distance != 1.0 and own.any() and not own.all():
            self._factors = np.where(own, 1.0, method.others_distance)
        some = np.arange(0, len(markers), max(1, len(markers) // 2048))
        self._typical_markers = np.mean(markers.take(some), axis=0, dtype=np.float64)

    @property
    def visited(self) -> int:
        """Number of distances computed by all searches so far."""
        return self.search.visited + self._sample.visited

    @cached_property
    def packed(self) -> Packed | None:
        """This locator as the kernel takes it; None if the search is not in cells."""
        if not isinstance(self.search, CellSearch):
            return None
        cells = self.search.packed(self.examples * _SPARE_CANDIDATES)
        own = self._subject.torso_weights, self._factors, float(self._alpha), float(self._pose_weight)
        return Packed(cells, self._subject.body.packed(), *own, self.examples, _TORSO_EXAMPLES)

    @cached_property
    def packed_hurried(self) -> Packed | None:
        """The same with the sample, for frames that must be located quickly."""
        wanted = self.examples * _SPARE_CANDIDATES
        return None if self.packed is None else Packed(self.packed, self._sample.packed, _SAMPLE_PASSES, wanted)

    def memory(self) -> tuple[NDArray[Any], ...]:
        """Return memory for the kernel: numbers of double and single precision, candidates, and frames found."""
        count, width, wanted = self._markers.count, self._markers.rows.shape[1], self.examples * _SPARE_CANDIDATES
        room = max(4 * self.examples, wanted + self._sample.step)
        room = max(room, self.search.room(wanted)) if isinstance(self.search, CellSearch) else room
        numbers = np.empty(13 * count + 3), np.empty(6 * count + 2 * width + self._poses.shape[1], dtype=np.float32)
        return (*numbers, np.empty((room, 2)), np.empty(room, dtype=np.int64))

    def locate(self, state: SolverState, observation: Observation, hurried: bool = False) -> Located | None:
        """Return root, closest examples and the start for the next search; None if the root cannot be found.

        Args:
            hurried: Use only the closest frames of the sample and their neighbours in time.
        """
        if hurried:
            return _locate_hurried(self, state, observation)
        if state.root is not None and state.pose is not None:
            return _locate_next(self, state, observation)
        return self.alternate(state, observation)

    def expected(self, state: SolverState) -> Array:
        """Return the markers (M, 3) in the root's frame to which the first root is fitted.

        They are those of the continued pose or, failing that, the expected ones or those of a typical pose.
        """
        if state.continued_pose is not None:
            return self._subject.markers(state.continued_pose.reshape(-1, 3))
        if state.root is not None and state.markers_m is not None:
            return state.root.to_root_frame(state.markers_m)
        return self._typical_markers

    def alternate(self, state: SolverState, observation: Observation, hurried: bool = False) -> Located | None:
        """Return the result of `locate` by searches and fits in turn."""
        continued, local = state.continued_pose, self.expected(state)
        root, found = state.root, state.found
        is_first = continued is None and not hurried
        frames: IntArray | None = None
        for _ in range(_SAMPLE_PASSES if hurried else 0):
            root = root_from_torso(observation, local, self._subject, root)
            if root is None:
                return None
            sampled = self._sample.nearest(self._query(observation, root, None), self.examples)
            frames = found = self._sample.around(sampled, self.examples * _SPARE_CANDIDATES)
            local = _closest_mean(self._markers, sampled)
        passes = _FIRST_ROOT_PASSES if is_first else _ROOT_PASSES
        for number in range(passes):
            root = root_from_torso(observation, local, self._subject, root)
            if root is None:
                return None
            query = self._query(observation, root, continued)
            # after the first pass the root moves little, so rank the same candidates again
            if is_first:
                frames, distances = self.search.nearest(query, self.examples * _SPARE_CANDIDATES, found)
                found = frames
            elif frames is None:
                frames = found = self.search.near(query, self.examples * _SPARE_CANDIDATES, found)
            else:
                frames, distances = self.search.nearest_among(query, frames)
            if number < passes - 1:
                local = _closest_mean(self._markers, frames)
        if root is None or frames is None or found is None:
            return None
        # people move more like themselves than like others: prefer the subject's own frames
        if self._factors is not None:
            distances = np.maximum(distances, 0.0)
            distances[1:] *= self._factors[frames[1:]]  # the closest stays first, because solutions are judged by it
            order = np.argsort(distances)
            frames, distances = frames[order], distances[order]
        chosen = frames[: self.examples]
        poses, markers_m = self._poses.take(chosen, axis=0), self._markers.take(chosen)
        examples = Examples(chosen, distances[: len(chosen)], poses, markers_m)
        seen = observation.located
        away_m = root.to_root_frame(observation.points_m[seen]) - markers_m[0][seen]
        nearest_m = math.sqrt(float(np.vdot(away_m, away_m)) / len(away_m)) if len(away_m) else math.nan
        return Located(root, examples, found, nearest_m)

    def _query(self, observation: Observation, root: RootPose, continued: Array | None) -> Query:
        """Return the query of Eq. 2, with the observed markers in the root's frame."""
        return Query(root.to_root_frame(observation.points_m), continued, self._alpha, self._pose_weight)

    def has_torso(self, observation: Observation) -> bool:
        """Return whether enough torso markers are located to fit a root without a previous one."""
        return int(np.count_nonzero(self._subject.torso & observation.located)) >= 3


_LOCATE = function("locate", "pppppppppppppp")
_HURRIED = function("locate_hurried", "ppppppppppppppp")


def _compiled(locator: Locator, state: SolverState, observation: Observation) -> Located | None:
    continued, before, packed = state.continued_pose, state.root, locator.packed
    if packed is None or continued is None or before is None:
        return locator.alternate(state, observation)
    given = packed.address, contiguous(observation.points_m), contiguous(continued)
    located, visited = _run(locator, partial(_LOCATE, *given), before)
    locator.search.visited += visited
    return located


def _compiled_hurried(locator: Locator, state: SolverState, observation: Observation) -> Located | None:
    continued, packed = state.continued_pose, locator.packed_hurried
    if packed is None:
        return locator.alternate(state, observation, hurried=True)
    if state.root is None and not locator.has_torso(observation):
        return None
    given = packed.address, contiguous(observation.points_m), contiguous(locator.expected(state))
    pose = None if continued is None else contiguous(continued)
    located, visited = _run(locator, partial(_HURRIED, *given, pose), state.root or ROOT_AT_REST)
    locator._sample.visited += visited
    return located


def _run(locator: Locator, locate: Callable[..., int], before: RootPose) -> tuple[Located, int]:
    """Return what a function of the kernel finds, and the number of distances that it computed."""
    wanted, shape, size = locator.examples, (locator._markers.count, 3), locator._poses.shape[1]
    *numbers, candidates, frames = locator.memory()
    root = np.concatenate((before.rotation, before.position_m))
    chosen, distances = np.empty(wanted, dtype=np.int64), np.empty(wanted)
    poses = np.empty((wanted, size), dtype=np.float32)
    markers_m = np.empty((wanted, *shape), dtype=np.float32)
    counts, nearest_m = np.empty(3, dtype=np.int64), np.empty(1)
    arrays = *numbers, candidates, root, frames, chosen, distances, poses, markers_m, counts, nearest_m
    checked(locate(*map(address, arrays)))
    found, count, visited = counts.tolist()
    examples = Examples(chosen[:count], distances[:count], poses[:count], markers_m[:count])
    return Located(RootPose(root[:4], root[4:]), examples, frames[:found], float(nearest_m[0])), visited


@stage(_compiled)
def _locate_next(locator: Locator, state: SolverState, observation: Observation) -> Located | None:
    return locator.alternate(state, observation)


@stage(_compiled_hurried)
def _locate_hurried(locator: Locator, state: SolverState, observation: Observation) -> Located | None:
    return locator.alternate(state, observation, hurried=True)


def _closest_mean(markers: DatabaseMarkers, frames: IntArray) -> Array:
    """Return the mean markers (M, 3) of the closest few of the frames (K,), which are ranked by distance."""
    closest = markers.take(frames[:_TORSO_EXAMPLES]).astype(np.float64)
    return np.asarray(np.add.reduce(closest) / len(closest))
