"""Pose solver: from labelled markers to poses, frame by frame."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from ..body.pose_notes import NoteKind
from ..database.store import Database, check_arrays
from ..errors import DatabaseError
from ..markers.source_noise import noise_of
from ..system.blas_threads import use_one_blas_thread
from .best_method import BestMethod
from .database_markers import database_markers
from .following import Follower, Frame, follow, misleads, remembering, rms, solved
from .lagged_history import LaggedHistory
from .locator import Located, Locator
from .method import FrameProblem, Method
from .method_factory import choose_method, choose_search
from .motion_prior import PriorEstimate
from .observation import Observation
from .search.sample import SampleSearch
from .settings import SolveSettings
from .solution import Solution, SolverState
from .subject_model import SubjectModel
from .trajectory_check import INTERVAL_S, PROVEN, TrajectoryCheck

_RETRY_S = 0.04  # pause after a failed re-initialisation
_NEARER = 0.6  # distance to the closest example, relative to the current pose's, below which a new pose replaces it


class PoseSolver:
    """Solves successive frames of one subject with one database.

    Attributes:
        initial_state: State before the first frame.
    """

    def __init__(self, subject: SubjectModel, database: Database, settings: SolveSettings) -> None:
        if database.frames < 2:
            raise DatabaseError("has fewer than two frames", where=str(database.path), advice="import more motion")
        check_arrays(database)
        use_one_blas_thread()
        self.subject, self.database = subject, database
        self.settings = settings
        markers = database_markers(subject, database)
        self._method: Method = choose_method(settings, subject, database, markers)
        search = choose_search(settings.search, database, markers)
        sample = SampleSearch(markers)
        self._locator = Locator(subject, database, markers, search, sample, self._method, settings.query_alpha)
        self._lasting_errors = noise_of(subject.subject.marker_set.points).lasting_m > 0.0
        self._trajectory_check: TrajectoryCheck | None = None
        if settings.method == "best":
            self._trajectory_check = TrajectoryCheck(sample, markers, self.best.earlier_markers)
        self._frame_s = 1.0 / database.fps
        history = LaggedHistory(self._method.longest_s)
        self.initial_state = SolverState(observed=history, solved=history)

    @property
    def visited(self) -> int:
        """Number of distances computed by all searches so far."""
        return self._locator.visited

    def backwards(self) -> "PoseSolver":
        """Return a solver for the time-reversed take; this needs the method "best"."""
        found = copy(self)
        found._method = self.best.backwards()
        found._trajectory_check = self._trajectory_check.backwards() if self._trajectory_check else None
        return found

    @property
    def best(self) -> BestMethod:
        """The method, if it is "best", the only one that can be reversed in time."""
        if not isinstance(self._method, BestMethod):
            raise TypeError(f"the method {self.settings.method!r} cannot be reversed in time; use 'best'")
        return self._method

    def begin_at_torso(self, solution: Solution) -> SolverState:
        """Return a state without history, except for a solution's root and markers."""
        return replace(self.initial_state, root=solution.root, markers_m=solution.markers_m)

    def closest_m(self, state: SolverState, observation: Observation) -> float:
        """Return the RMS distance (m) of the markers from the closest example, NaN without markers."""
        in_space = self._in_space(state, observation)
        located = self._locator.locate(state, in_space, hurried=True)
        return located.nearest_m if located is not None else float("nan")

    def negative_log_likelihood(self, state: SolverState) -> float:
        """Return the negative log density of the last markers, for metres; 0 for methods other than "best"."""
        return 0.0 if state.expectation is None else state.expectation.negative_log_likelihood(self.subject)

    def step(
        self,
        state: SolverState,
        observation: Observation,
        time_s: float | None = None,
        hurried: bool = False,
        limit_m: float = np.inf,
        learned: PriorEstimate | None = None,
    ) -> tuple[Solution | None, SolverState]:
        """Return the pose of the next frame and the state after it.

        Args:
            state: State after the last frame, or the initial one. For a first frame with only rays, it can contain
                expected markers.
            time_s: Time of the frame; by default one frame interval of the database after the last.
            hurried: The frame was already expensive, so a first frame's pose is not refined.
            limit_m: RMS distance of the markers from the closest example from which on a first frame is not solved.
            learned: Learned prior, if it was computed before (see `BestMethod.learned_priors`).

        Returns:
            No pose while too few torso markers are visible to find the body.
        """
        state = replace(state, time_s=state.time_s + self._frame_s if time_s is None else time_s, learned=learned)
        if state.pose is None:
            solution, state = self._begin(state, observation, hurried, limit_m)
        else:
            before = state
            solution, state = self._advance(before, observation)
            if solution is not None:
                solution, state = self._settled(before, observation, solution, state)
        return solution, remembering(state, self._in_space(state, observation), solution)

    def follow(self, state: SolverState, frames: Sequence[Frame]) -> tuple[list[Solution | None], SolverState]:
        """Return the poses of the next frames, as many as can be solved together, and the state after them.

        They are the same as those of `step`, frame by frame; this needs the method "best".

        Args:
            frames: At least one, with learned priors if they are known.
        """
        together = self._together(state, frames)
        if together < 2:
            solution, state = self.step(state, *frames[0][:2], learned=frames[0].learned)
            return [solution], state
        waits = (frame.time_s - state.reinitialise_failed_s < _RETRY_S for frame in frames)
        model = Follower(self._locator, self.best.model, self._lasting_errors)
        solutions, after, before = follow(model, state, frames[:together], sum(waits))
        observation = frames[len(solutions) - 1].observation
        last, after = self._settled(before, observation, solutions[-1], after)
        return [*solutions[:-1], last], remembering(after, observation, last)

    def _together(self, state: SolverState, frames: Sequence[Frame]) -> int:
        """Return how many frames can be solved together: until a comparison is due, while the torso shows the root."""
        if state.pose is None or state.root is None or state.markers_m is None:
            return 0
        for number, (observation, time_s, learned) in enumerate(frames):
            torso = np.count_nonzero(self.subject.torso & observation.located)
            if torso < 3 or observation.guessed.any() or (learned is None) == self.best.learns:
                return number
            if time_s - state.compared_s >= INTERVAL_S:
                return number + 1
        return len(frames)

    def _settled(
        self, before: SolverState, observation: Observation, solution: Solution, state: SolverState
    ) -> tuple[Solution, SolverState]:
        """Return a pose, or another one if history has misled it, and the state after it."""
        if reason := self._reason_to_reinitialise(before, observation, solution):
            return self.reinitialise(before, observation, solution, state, reason)
        if self._trajectory_check and state.time_s - state.compared_s >= INTERVAL_S:
            return self._check_trajectory(self._trajectory_check, before, observation, solution, state)
        return solution, state

    def reinitialise(
        self, state: SolverState, observation: Observation, solution: Solution, after: SolverState, reason: NoteKind
    ) -> tuple[Solution, SolverState]:
        """Return the pose solved without history if that is nearer to the database, otherwise the given one.

        Args:
            state: State before the frame, with the frame's time.
            solution: Solution with history, which is returned if it is better.
            after: State after that solution.
            reason: Why history may mislead. After a cut, the pose without history is used if it is nearer, otherwise
                only if it is much nearer.
        """
        fresh = replace(self.initial_state, root=state.root, time_s=state.time_s, learned=state.learned)
        seen = observation.located
        away_m = max(solution.nearest_m, rms(solution.markers_m[seen] - observation.points_m[seen]))
        nearer = 1.0 if reason is NoteKind.CUT else _NEARER
        found, first = self._begin(fresh, observation, True, nearer * away_m)
        if found is not None:
            return replace(found, reinitialised=True, begun=reason), first
        return replace(solution, reinitialised=True), replace(after, reinitialise_failed_s=state.time_s)

    def _check_trajectory(
        self,
        check: TrajectoryCheck,
        before: SolverState,
        observation: Observation,
        solution: Solution,
        state: SolverState,
    ) -> tuple[Solution, SolverState]:
        """Return the pose solved without earlier poses if there is enough evidence that these are wrong."""
        in_space = self._in_space(before, observation)
        if state.found is None:
            return solution, state
        evidence = check.evidence(before, in_space, solution.root, state.found)
        fresh = replace(self.initial_state, root=solution.root, observed=before.observed)
        fresh = replace(fresh, time_s=state.time_s, learned=state.learned)
        located = self._locator.locate(fresh, in_space, hurried=True) if evidence > PROVEN else None
        if located is None:
            return solution, replace(state, compared_s=state.time_s, evidence=evidence)
        better, state = self._estimate(fresh, observation, located)
        begun = replace(better, reinitialised=True, begun=NoteKind.OTHER_MOTION)
        return begun, replace(state, compared_s=state.time_s)

    def _begin(
        self, state: SolverState, observation: Observation, hurried: bool, limit_m: float
    ) -> tuple[Solution | None, SolverState]:
        """Return the pose of a first frame, or None, and the state after it.

        Unless hurried, the pose is solved twice, the second time with the torso and the neighbours of the first pose.
        """
        in_space = self._in_space(state, observation)
        located = self._locator.locate(state, in_space, hurried)
        if located is None or located.nearest_m >= limit_m:
            return None, state
        first, after = self._estimate(state, observation, located)
        again, second = (None, after) if hurried else self._advance(after, observation)
        return (again, second) if again is not None else (first, after)

    def _reason_to_reinitialise(
        self, state: SolverState, observation: Observation, solution: Solution
    ) -> NoteKind | None:
        """Return why history may mislead, or None if there is no sign that it does."""
        if state.time_s - state.reinitialise_failed_s < _RETRY_S or not self._method.fits_markers:
            return None  # methods that do not fit markers are always as far from the markers as the example
        if observation.guessed.any():
            observation = self._in_space(state, observation)
        return misleads(state, observation, solution, self._lasting_errors)

    def _in_space(self, state: SolverState, observation: Observation) -> Observation:
        return observation.with_torso_in_space(self.subject.torso, state.markers_m)

    def _advance(self, state: SolverState, observation: Observation) -> tuple[Solution | None, SolverState]:
        located = self._locator.locate(state, self._in_space(state, observation))
        return (None, state) if located is None else self._estimate(state, observation, located)

    def _estimate(self, state: SolverState, observation: Observation, located: Located) -> tuple[Solution, SolverState]:
        """Return the pose for a root and examples, and the state after it."""
        problem = FrameProblem(state, observation, located.root, located.examples)
        return solved(self.subject, state, located, self._method.estimate(problem))
