"""Time of one frame by stage."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.database.store import Database
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.marker_smoothing import MarkerSmoother
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.frame_labelling import FrameLabeller
from perfanim.core.session.session import Session
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver import gaussian_conditioning
from perfanim.core.solver.best_method import BestMethod
from perfanim.core.solver.locator import Locator
from perfanim.core.solver.motion_prior import MotionPrior
from perfanim.core.solver.pose_solver import PoseSolver

from .figure6 import true_subject

WHOLE = "whole frame"
# each without the stages that it calls
_STAGES: tuple[tuple[str, Any, tuple[str, ...]], ...] = (
    ("rest", Session, ("step",)),
    ("label", FrameLabeller, ("label",)),
    ("smooth markers", MarkerSmoother, ("step",)),
    ("root and examples", Locator, ("locate",)),
    ("prior of the neighbours", BestMethod, ("_prior",)),
    ("learned prior", MotionPrior, ("estimate",)),
    ("join priors", BestMethod, ("estimate",)),
    ("fit", gaussian_conditioning, ("fit_to_markers",)),
    ("checks", PoseSolver, ("_check_trajectory", "reinitialise")),
    ("checks", Session, ("_escape_local_minimum", "_compare_labels")),
    ("pose out", Session, ("_solved_pose",)),
)
SEARCH, CHECKS = "search", "checks"
_FIRST_FRAMES = 20  # that a session begins in
_MOST_FRAMES = 600


class _Stopwatch:
    """Processor time of stages within others, a frame at a time, in ms."""

    def __init__(self) -> None:
        self.frame: dict[str, float] = {}
        self._running: list[str] = []
        self._since_s = 0.0

    def timed(self, stage: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function with its time counted for a stage, checks with all they call."""

        def run(*given: Any, **named: Any) -> Any:
            if CHECKS in self._running:
                return work(*given, **named)
            self._switch()
            self._running.append(stage)
            try:
                return work(*given, **named)
            finally:
                self._switch()
                self._running.pop()

        return run

    def _switch(self) -> None:
        now_s = time.process_time()
        if self._running:
            stage = self._running[-1]
            self.frame[stage] = self.frame.get(stage, 0.0) + 1e3 * (now_s - self._since_s)
        self._since_s = now_s


def frame_stages(take: str, truth: Motion, database: Database, reference_ms: float) -> list[dict[str, Any]]:
    """Return the processor time of each stage of unlabelled frames, on one core.

    Args:
        take: its name in the rows.
        reference_ms: processor time of one exhaustive search in NumPy.
    """
    subject, watch = true_subject(truth), _Stopwatch()
    frames = take_frames(simulate_markers(truth, subject)[0], subject.marker_set)
    taken: list[dict[str, float]] = []
    with ExitStack() as patches:
        for stage, owner, names in _STAGES:
            for name in names:
                patches.enter_context(patch.object(owner, name, watch.timed(stage, getattr(owner, name))))
        session = Session(subject, database)
        search = session.solver._locator._search
        for name in ("nearest", "near", "nearest_among"):
            patches.enter_context(patch.object(search, name, watch.timed(SEARCH, getattr(search, name))))
        for number, frame in enumerate(frames):
            if number == _FIRST_FRAMES + _MOST_FRAMES:
                break
            session.step(without_labels(frame, number))
            taken.append(watch.frame)
            watch.frame = {}
    stages = [*dict.fromkeys(("label", "smooth markers", "root and examples", SEARCH, *(row[0] for row in _STAGES)))]
    columns = {stage: np.array([row.get(stage, 0.0) for row in taken[_FIRST_FRAMES:]]) for stage in stages}
    columns[WHOLE] = np.sum(list(columns.values()), axis=0)
    return [_row(take, database, stage, column, reference_ms) for stage, column in columns.items()]


def without_labels(frame: Any, seed: int) -> Any:
    """Return a marker frame as cameras give it: in any order, without labels."""
    order = np.random.default_rng(seed).permutation(len(frame.points_m))
    return type(frame)(frame.number, frame.time_s, frame.points_m[order], frame.covariances_m2[order])


def _row(take: str, database: Database, stage: str, milliseconds: Array, reference_ms: float) -> dict[str, Any]:
    median, p99 = float(np.median(milliseconds)), float(np.percentile(milliseconds, 99))
    return {
        "take": take,
        "database_frames": database.frames,
        "stage": stage,
        "mean_ms": round(float(np.mean(milliseconds)), 3),
        "median_ms": round(median, 3),
        "p99_ms": round(p99, 3),
        "median_of_reference": round(median / reference_ms, 4),
        "p99_of_reference": round(p99 / reference_ms, 4),
    }
