"""Following a body with one set of labels: smoothing and solving its markers, frame by frame."""

from copy import deepcopy
from dataclasses import replace

import numpy as np

from ..geometry.arrays import Array, Mask
from ..markers.frozen_markers import FrozenMarkers
from ..markers.jump_gate import Carried
from ..markers.marker_smoothing import MarkerSmoother
from ..markers.source_noise import SourceNoise
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.solution import SolverState
from .hypotheses import Tracked

_FASTEST_M_S = 10.0  # speed above which torso markers are not extrapolated: no torso is so fast
_WORN_S = 0.2  # time constant for averaging a marker's offset from the solved body


class BodyFollower:
    """Smooths and solves the labelled markers of one body.

    Args:
        feet: Mask (M,) of the markers on feet.
        gates_jumps: Doubt markers that jump. Cameras have decided a network's left and right before, and its errors
            last: a point that jumps is no worse.

    Attributes:
        state: State of the solver after the last frame.
        before: State before it.
    """

    def __init__(self, solver: PoseSolver, source: SourceNoise, feet: Mask, gates_jumps: bool) -> None:
        self._solver, self._source, self._feet, self._gates_jumps = solver, source, feet, gates_jumps
        self.state = self.before = solver.initial_state
        self._velocities_m_s: Array | None = None  # (M, 3) of the solved markers
        self._apart_m = np.full((len(feet), 3), np.nan)  # mean offsets of observed from solved markers
        self._frozen = FrozenMarkers(feet)
        self._smoother = MarkerSmoother(len(feet), source, feet=feet)

    def begun_again(self, state: SolverState) -> "BodyFollower":
        """Return a follower of the same body that continues from another state of the solver."""
        other = BodyFollower(self._solver, self._source, self._feet, self._gates_jumps)
        other.state = state
        return other

    def copy(self) -> "BodyFollower":
        """Return a follower that goes on independently from the state before the last frame."""
        other = self.begun_again(self.before)
        other._velocities_m_s, other._apart_m = self._velocities_m_s, self._apart_m
        other._frozen, other._smoother = deepcopy(self._frozen), deepcopy(self._smoother)
        return other

    def begin(self, observation: Observation, time_s: float) -> Tracked:
        """Return a frame solved with new labels, without smoothing."""
        self.before = self.state
        solution, self.state = self._solver.step(self.state, observation, time_s, True)
        return Tracked.of(observation, solution)

    def step(self, observation: Observation, time_s: float, elapsed_s: float, doubts: bool, hurried: bool) -> Tracked:
        """Return the next frame, smoothed and solved.

        Args:
            elapsed_s: Time since the last frame.
            doubts: Doubt markers that jump or that the source repeats.
            hurried: The frame was already expensive, so the pose of a first frame is not refined.
        """
        doubts = doubts and not observation.guessed.any()
        points_m, frozen = observation.points_m, np.zeros(len(self._feet), dtype=bool)
        if doubts:
            frozen = self._frozen.step(points_m, elapsed_s)
            points_m = np.where(frozen[:, None], np.nan, points_m)
        found = self._smoother.step(
            time_s, points_m, self._carried(elapsed_s) if doubts and self._gates_jumps else None
        )
        smoothed = observation.smoothed(found.points_m, found.deviations_m, self._source)
        observation = replace(observation, points_m=found.believed.points_m)
        self.before = self.state
        solution, self.state = self._solver.step(self.state, smoothed, time_s, hurried)
        self._note_markers(observation, elapsed_s)
        believed = found.believed
        return Tracked(observation, smoothed.points_m, believed.doubted, frozen, believed.exchanged, solution)

    def _carried(self, elapsed_s: float) -> Carried:
        """Return where the torso markers should be, extrapolated from the last two poses."""
        torso = self._solver.subject.torso
        carried_m = np.full((len(torso), 3), np.nan)
        if self.state.markers_m is not None and self._velocities_m_s is not None:
            slow = torso & (np.linalg.norm(self._velocities_m_s, axis=1) < _FASTEST_M_S)  # faster after a cut
            # markers are not worn exactly where the body model has them, so their mean offsets are added
            worn_m = self.state.markers_m + np.nan_to_num(self._apart_m)
            carried_m[slow] = (worn_m + elapsed_s * self._velocities_m_s)[slow]
        return Carried(carried_m, self._nearness)

    def closest_m(self, observation: Observation) -> float:
        """Return the distance of markers from the closest example, whatever the motion before."""
        fresh = replace(self._solver.initial_state, root=self.state.root, markers_m=self.state.markers_m)
        return self._solver.closest_m(fresh, observation)

    def _nearness(self, given_m: Array, corrected_m: Array) -> float:
        """Return the distance of markers (M, 3) from the closest example, relative to that of others."""
        own_m, other_m = (self.closest_m(Observation.of_points(each)) for each in (given_m, corrected_m))
        return own_m / max(other_m, 1e-9)

    def _note_markers(self, observation: Observation, elapsed_s: float) -> None:
        """Remember the velocities of the solved markers, and the mean offsets of observed markers from solved ones."""
        if self.state.markers_m is None:
            return
        if self.before.markers_m is not None and elapsed_s > 0.0:
            self._velocities_m_s = (self.state.markers_m - self.before.markers_m) / elapsed_s
        apart_m = observation.points_m - self.state.markers_m
        mean_m = self._apart_m + -np.expm1(-elapsed_s / _WORN_S) * (apart_m - self._apart_m)
        apart_m = np.where(np.isfinite(mean_m), mean_m, apart_m)
        self._apart_m = np.where(np.isfinite(apart_m), apart_m, self._apart_m)
