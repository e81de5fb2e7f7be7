"""Hypotheses about labels, followed in parallel.

Points that come near each other, or reappear, have several possible labels, and only the motion that follows shows
which are right (multiple hypothesis tracking, Reid 1979). Each hypothesis has labels, a body solved with them, and a
cost: the negative log likelihood of its labels so far, relative to the best hypothesis. `LabelFinder`s continue
hypotheses and propose new ones, from two or more cameras (`point_labels`) or from one (`one_camera_labels`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from ..body.pose_notes import NoteKind
from ..geometry.arrays import Array, Mask
from ..markers.marker_frame import MarkerFrame
from ..solver.observation import Observation
from ..solver.solution import Solution, SolverState


@dataclass(frozen=True)
class HypothesisSettings:
    """Settings of `Hypotheses`; costs are negative log likelihoods, nats."""

    most: int = 5  # number of hypotheses
    lead: float = 2.0  # gain over the best hypothesis that makes another the best
    most_frame: float = 60.0  # cap on the cost of one frame, so that no outlier is decisive
    same_m: float = 0.02  # distance up to which two points, or two bodies with the same labels, are the same


SETTINGS = HypothesisSettings()


@dataclass(frozen=True)
class Tracked:
    """A labelled and solved frame."""

    observation: Observation  # markers that are used
    known_m: Array  # (M, 3) positions for the solver: smoothed, and extrapolated while briefly hidden
    doubted: Mask  # (M,) markers that jumped
    frozen: Mask  # (M,) markers whose positions the source repeats
    exchanged: Mask  # (M,) markers whose exchanged labels were corrected
    solution: Solution | None

    @classmethod
    def of(cls, observation: Observation, solution: Solution | None) -> "Tracked":
        """Return a frame without any doubts, smoothing or corrections."""
        count = len(observation.points_m)
        none = np.zeros(count, dtype=bool)
        return cls(observation, np.full((count, 3), np.nan), none, none, none, solution)


@dataclass(eq=False)
class Hypothesis:
    """Labels so far, and the body solved with them."""

    state: SolverState
    tracked: Tracked
    begun: NoteKind | None  # how its labels were found; None if the source gave them
    cost: float  # relative to the best hypothesis
    lineage: object  # the same for all continuations of one beginning

    def is_like(self, other: "Hypothesis") -> bool:
        """Return whether another hypothesis has the same labels now, and the same body."""
        one, two = self.tracked, other.tracked
        same_points = np.array_equal(one.observation.points_m, two.observation.points_m, equal_nan=True)
        same_rays = np.array_equal(one.observation.image_points, two.observation.image_points, equal_nan=True)
        if not (same_points and same_rays) or one.solution is None or two.solution is None:
            return False
        return bool(np.abs(one.solution.markers_m - two.solution.markers_m).max() < SETTINGS.same_m)


H = TypeVar("H", bound=Hypothesis)


class LabelFinder(Protocol[H]):
    """Finds the labels of one body's points.

    Attributes:
        hopeless: Cost above which a hypothesis is dropped.
    """

    hopeless: float

    def reset(self) -> None:
        """Forget the motion so far."""

    def begin(self, frame: MarkerFrame, elapsed_s: float) -> H | None:
        """Return a hypothesis for the frame, found without history; None if there is none yet."""

    def continued(self, hypotheses: Sequence[H], frame: MarkerFrame, elapsed_s: float, checks: bool) -> list[H]:
        """Return all hypotheses with the labels of the next frame, costs included."""

    def others(self, hypotheses: Sequence[H], frame: MarkerFrame, elapsed_s: float) -> list[H]:
        """Return new hypotheses for a frame, given those so far, the best first."""

    def confidence(self, hypotheses: Sequence[H], frame: MarkerFrame) -> float:
        """Return the factor by which uncertain labels lower the confidence in the pose of the best hypothesis."""


class Hypotheses(Generic[H]):
    """Hypotheses about the labels of one body, frame by frame.

    Attributes:
        found: Hypotheses after the last frame, the best first.
        changed: How the labels of the best one were found, if the last frame made it the best.
        labellings: Number of times so far that labels were found or replaced.
    """

    def __init__(self, finder: LabelFinder[H]) -> None:
        self._finder, self.labellings = finder, 0
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self.found: list[H] = []
        self.changed: NoteKind | None = None
        self._lineage: object = None
        self._time_s: float | None = None
        self._finder.reset()

    @property
    def best(self) -> H | None:
        """The best hypothesis, if there is any."""
        return self.found[0] if self.found else None

    def step(self, frame: MarkerFrame, checks: bool = True) -> H | None:
        """Return the best hypothesis after the next frame; None while there is none.

        Args:
            checks: Compare labels with others, and doubt given labels whose markers jump.
        """
        elapsed_s = 0.0 if self._time_s is None else frame.time_s - self._time_s
        self._time_s = frame.time_s
        found = self._ranked(self._finder.continued(self.found, frame, elapsed_s, checks)) if self.found else []
        if found and checks:
            found = self._ranked([*found, *self._finder.others(found, frame, elapsed_s)])
        elif not found:
            first = self._finder.begin(frame, elapsed_s)
            found = [] if first is None else [first]
        self.found = found
        lineage = found[0].lineage if found else None
        self.changed = found[0].begun if found and lineage is not self._lineage else None
        self.labellings += self.changed not in (None, NoteKind.NEARER_EXAMPLE)
        self._lineage = lineage
        return self.best

    def confidence(self, frame: MarkerFrame) -> float:
        """Return the factor by which uncertain labels lower the confidence in the last pose."""
        return self._finder.confidence(self.found, frame)

    def _ranked(self, hypotheses: Sequence[H]) -> list[H]:
        """Return the likely hypotheses, the best first, with costs relative to its."""
        ranked = sorted(hypotheses, key=lambda each: each.cost - SETTINGS.lead * (each.lineage is self._lineage))
        result: list[H] = []
        least = ranked[0].cost if ranked else 0.0
        for hypothesis in ranked:
            hypothesis.cost -= least
            if hypothesis.cost <= self._finder.hopeless and not any(map(hypothesis.is_like, result)):
                result.append(hypothesis)
        return result[: SETTINGS.most]
