"""Frames that are solved together are those that are solved one by one, by both bodies."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.database.cells import build_cells
from perfanim.core.kernel.library import Stage, use_kernel
from perfanim.core.solver import following
from perfanim.core.solver.following import Frame
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.settings import BestSettings, SolveSettings
from perfanim.core.solver.solution import Solution

LAST = 36
FPS = 30.0
FOLLOW = following._FOLLOW
SINGLE = 2e-5  # share of a value that rounding in single precision may cost
# Factors where markers are far from all examples, whose weights then hang on rounding. After a cut to what is no body,
# the bodies of the stages are not compared, but for each of them frames together with frames one by one.
FAR = {"cut": 0.0, "unlike": 10.0}


@pytest.fixture(scope="module", params=[True, False], ids=["learned prior", "no learned prior"])
def solver(request, database, model) -> PoseSolver:
    database = replace(database, cells=build_cells(database.poses, database.mean_rotations))
    return PoseSolver(model, database, SolveSettings(best=BestSettings(prior_share=1.0 if request.param else 0.0)))


def frames_of(solver: PoseSolver, markers_m: np.ndarray, way: int = 1) -> list[Frame]:
    """Return frames with their learned priors."""
    seen = [(Observation.of_points(each, np.full(len(each), 0.002)), each) for each in markers_m]
    times_s = np.arange(len(markers_m)) / FPS
    learned = solver.best.learned_priors([(seen_, np.nan_to_num(each)) for seen_, each in seen], times_s)
    return [Frame(each[0], way * time_s, prior) for each, time_s, prior in zip(seen, times_s, learned, strict=True)][
        ::way
    ]


def disturbed(true_markers: np.ndarray, disturbance: str) -> np.ndarray:
    markers_m = true_markers[:LAST].copy()
    generator = np.random.default_rng(5)
    if disturbance == "hidden":
        markers_m[generator.random(markers_m.shape[:2]) < 0.2] = np.nan
    elif disturbance == "torso hidden":
        markers_m[20:24, :6] = np.nan
    elif disturbance == "cut":
        markers_m[22:] = markers_m[22:, ::-1] + 0.5
    elif disturbance == "unlike":
        markers_m[18:25, -2:] += 0.4
    return markers_m


def solutions_of(solver: PoseSolver, frames: list[Frame], most: int, share: float = 0.0) -> list[Solution | None]:
    """Return the solutions of frames, of which at most so many are given at once.

    Args:
        share: If given, the other body must find the same within this share, from the same states.
    """
    found, state = [], solver.initial_state
    while len(found) < len(frames):
        coming, before = frames[len(found) : len(found) + most], state
        solutions, state = solver.follow(before, coming)
        if share:
            is_compiled = Stage.is_compiled
            use_kernel(not is_compiled)
            others, _ = solver.follow(before, coming)
            use_kernel(is_compiled)
            assert_all_same(solutions, others, share)
        found += solutions
    return found


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("disturbance", ["nothing", "hidden", "torso hidden", "cut", "unlike"])
def test_frames_together_are_those_one_by_one(solver, true_markers, disturbance, way):
    directed = solver if way > 0 else solver.backwards()
    frames = frames_of(directed, disturbed(true_markers, disturbance), way)
    for is_compiled in (False, True):
        assert use_kernel(is_compiled) == is_compiled
        together = solutions_of(directed, frames, 16, FAR.get(disturbance, 1.0) * SINGLE * is_compiled)
        assert_all_same(solutions_of(directed, frames, 1), together, 0.0)
        assert sum(each is not None for each in together) > len(frames) // 2


def test_many_frames_are_one_call(solver, true_markers, monkeypatch):
    """Or the test above would compare frames that are solved one by one either way."""
    calls = []
    monkeypatch.setattr(following, "_FOLLOW", lambda *given: calls.append(1) or FOLLOW(*given))
    solutions_of(solver, frames_of(solver, disturbed(true_markers, "nothing")), 16)
    assert 3 <= len(calls) <= LAST // 2


def assert_all_same(some: list[Solution | None], others: list[Solution | None], share: float) -> None:
    assert [each is None for each in some] == [each is None for each in others]
    for one, other in zip(some, others, strict=True):
        if one is not None:
            assert_same(one, other, share)


def assert_same(one: Solution, other: Solution, share: float) -> None:
    for name in ("pose", "markers_m", "uncertainty_rad", "nearest_m", "tilt_rad"):
        expected, found = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=share * max(np.abs(expected).max(), 1.0))
    np.testing.assert_allclose(other.root.rotation, one.root.rotation, rtol=0.0, atol=share)
    np.testing.assert_allclose(other.root.position_m, one.root.position_m, rtol=0.0, atol=10.0 * share)
    assert (other.neighbours, other.dimensions, other.begun, other.reinitialised, other.prior_led) == (
        one.neighbours, one.dimensions, one.begun, one.reinitialised, one.prior_led,
    )  # fmt: skip
