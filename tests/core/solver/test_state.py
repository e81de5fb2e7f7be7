"""Solvers that part: each goes on as if the other were not."""

import numpy as np
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.settings import SolveSettings


def test_a_branch_goes_its_own_way(model, database, true_markers):
    settings = SolveSettings(search="exhaustive")
    common, there, elsewhere = (Observation.of_points(true_markers[i]) for i in (20, 21, 50))
    solver = PoseSolver(model, database, settings)
    solver.step(common)
    branch = solver.branch()
    solver.step(there)
    branch.step(elsewhere)
    ends = [solver.step(there), branch.step(elsewhere)]
    for observation, end in zip((there, elsewhere), ends, strict=True):
        alone = PoseSolver(model, database, settings)
        for each in (common, observation, observation):
            last = alone.step(each)
        np.testing.assert_array_equal(end.pose, last.pose)


def test_exchanged_markers_are_a_surprise(model, database, true_markers):
    solver = PoseSolver(model, database, SolveSettings())
    assert solver.negative_log_likelihood() == 0.0
    for row in true_markers[20:30]:
        solver.step(Observation.of_points(row))
    branch = solver.branch()
    exchanged = true_markers[30].copy()
    names = list(model.subject.marker_set.names)
    hands = [names.index("LHAN"), names.index("RHAN")]
    exchanged[hands] = exchanged[hands[::-1]]
    solver.step(Observation.of_points(true_markers[30]))
    branch.step(Observation.of_points(exchanged))
    # a factor of a thousand is far beyond what noise and the next frames could make good
    assert branch.negative_log_likelihood() > solver.negative_log_likelihood() + np.log(1000.0)
