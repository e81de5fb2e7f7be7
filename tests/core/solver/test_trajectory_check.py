"""A part of the database that follows the markers worse than another is found out."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.database.store import Database
from perfanim.core.solver.database_markers import database_markers
from perfanim.core.solver.lagged_history import LaggedFrames, LaggedHistory, LaggedMarkers
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.root import root_from_torso
from perfanim.core.solver.search.exhaustive import ExhaustiveSearch, Query
from perfanim.core.solver.search.sample import SampleSearch
from perfanim.core.solver.solution import SolverState
from perfanim.core.solver.subject_model import SubjectModel
from perfanim.core.solver.trajectory_check import INTERVAL_S, PROVEN, TrajectoryCheck

LAGS_S = (0.1, 0.25)
Follow = Callable[[np.ndarray], list[float]]


@pytest.fixture(scope="module")
def follow(model: SubjectModel, database: Database, true_markers: np.ndarray) -> Follow:
    """Return a function of allowed frames (F,): evidence against their nearest, at each comparison."""
    markers, poses = database_markers(model, database), database.poses.reshape(database.frames, -1)
    markers_m = markers.all()
    everything = ExhaustiveSearch(markers_m, poses)
    earlier = LaggedMarkers(database, markers, LaggedFrames(database, LAGS_S))
    check = TrajectoryCheck(SampleSearch(markers), markers, earlier)

    def evidence(allowed: np.ndarray) -> list[float]:
        state, result = SolverState(observed=LaggedHistory(LAGS_S[-1])), []
        for number, points in enumerate(true_markers):
            state = replace(state, time_s=number / database.fps)
            seen = Observation.of_points(points)
            root = root_from_torso(seen, markers_m.mean(axis=0), model, state.root)
            assert root is not None
            if state.time_s - state.compared_s >= INTERVAL_S:
                query = Query(root.to_root_frame(points), None, 1.0, 0.0)
                examples, _ = everything.nearest_among(query, allowed)
                against = check.evidence(state, seen, root, examples)
                state = replace(state, compared_s=state.time_s, evidence=against)
                result.append(against)
            state = replace(state, root=root, observed=state.observed.remember(state.time_s, points))
        return result

    return evidence


def test_nearest_examples_are_never_evidence_against_the_trajectory(database: Database, follow: Follow) -> None:
    assert max(follow(np.arange(database.frames))) == 0.0


def test_examples_of_another_behaviour_are_proven_wrong_within_half_a_second(
    database: Database, follow: Follow
) -> None:
    is_boxing = np.array([clip.name.startswith("boxing") for clip in database.clips])[database.clip_of_frame]
    against = follow(np.flatnonzero(is_boxing))
    assert max(against[: round(0.5 / INTERVAL_S)]) > PROVEN
