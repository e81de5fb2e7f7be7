"""States of a solver that part: each goes on as if the other were not."""

import numpy as np
import pytest
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.settings import SolveSettings


@pytest.mark.parametrize("search", ["exhaustive", "graph"])
def test_continuations_of_a_state_are_independent(model, database, true_markers, search):
    settings = SolveSettings(search=search)
    common, there, elsewhere = (Observation.of_points(true_markers[i]) for i in (20, 21, 50))
    solver = PoseSolver(model, database, settings)
    _, state = solver.step(solver.initial_state, common)
    states = [solver.step(state, observation)[1] for observation in (there, elsewhere)]
    ends = [solver.step(*each)[0] for each in zip(states, (there, elsewhere), strict=True)]
    for observation, end in zip((there, elsewhere), ends, strict=True):
        alone = PoseSolver(model, database, settings)
        last, state = alone.step(alone.initial_state, common)
        for _ in range(2):
            last, state = alone.step(state, observation)
        np.testing.assert_array_equal(end.pose, last.pose)


def test_exchanged_markers_have_a_lower_likelihood(model, database, true_markers):
    solver = PoseSolver(model, database, SolveSettings())
    state = solver.initial_state
    assert solver.negative_log_likelihood(state) == 0.0
    for row in true_markers[20:30]:
        _, state = solver.step(state, Observation.of_points(row))
    exchanged = true_markers[30].copy()
    names = list(model.subject.marker_set.names)
    hands = [names.index("LHAN"), names.index("RHAN")]
    exchanged[hands] = exchanged[hands[::-1]]
    _, right = solver.step(state, Observation.of_points(true_markers[30]))
    _, wrong = solver.step(state, Observation.of_points(exchanged))
    # a factor of a thousand is far beyond noise and the next frames
    assert solver.negative_log_likelihood(wrong) > solver.negative_log_likelihood(right) + np.log(1000.0)
