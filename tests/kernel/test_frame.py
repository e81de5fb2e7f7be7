"""The stages of a whole frame by the kernel are those of NumPy: root and examples, learned prior, estimate."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from perfanim.core.database.cells import build_cells
from perfanim.core.kernel.library import use_kernel
from perfanim.core.solver.best_estimate import best_estimate
from perfanim.core.solver.database_markers import database_markers
from perfanim.core.solver.lagged_history import LaggedHistory
from perfanim.core.solver.locator import Located
from perfanim.core.solver.method import FrameProblem
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.search import sample
from perfanim.core.solver.search.inverted_file import CellSearch
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.solver.solution import SolverState
from two_bodies import seen_by

SINGLE = 2e-5  # share of a value that rounding in single precision may cost, through a covariance of it
SOLVED = 12  # number of frames solved before the compared one
HIDDEN = [(), (0, 3), (0, 1, 2, 3, 4), range(8)]
SPECIAL = [None, np.nan, np.inf, -1e30]


@contextmanager
def body(is_compiled: bool) -> Iterator[None]:
    """Let all stages use one body."""
    assert use_kernel(is_compiled) == is_compiled
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        use_kernel(True)


def both(work: Callable[[], Any]) -> list[Any]:
    """Return the results of NumPy and of the kernel; None where the input is refused."""
    results = []
    for is_compiled in (False, True):
        with body(is_compiled):
            try:
                results.append(work())
            except np.linalg.LinAlgError:
                results.append(None)
    return results


def assert_close(found: Any, expected: Any, share: float = SINGLE) -> None:
    """Require equal arrays within a share of their largest value."""
    known = np.isfinite(expected)
    largest = np.abs(np.asarray(expected)[known]).max(initial=1.0)
    np.testing.assert_allclose(np.asarray(found)[known], np.asarray(expected)[known], rtol=0.0, atol=share * largest)


@pytest.fixture(scope="module", params=[6144, 1200, 1])
def solver(request, database, model) -> PoseSolver:
    """A solver that scans all frames of the small database, some of its cells, or as few as it can."""
    database = replace(database, cells=build_cells(database.poses, database.mean_rotations))
    found = PoseSolver(model, database, SolveSettings())
    poses = database.poses.reshape(database.frames, -1)
    found._locator.search = CellSearch(database_markers(model, database), poses, scanned=request.param)
    return found


@pytest.fixture(scope="module")
def state(solver, true_markers) -> SolverState:
    """The state after some frames."""
    found = solver.initial_state
    with body(False):
        for markers_m in true_markers[:SOLVED]:
            _, found = solver.step(found, Observation.of_points(markers_m))
    return replace(found, time_s=found.time_s + 1.0 / 30.0)


def with_points(true_markers: np.ndarray, hidden: Any, special: float | None) -> Observation:
    points_m = true_markers[SOLVED].copy()
    points_m[list(hidden)] = np.nan
    if special is not None:
        points_m[5, 1] = special
    return Observation.of_points(points_m, np.full(len(points_m), 0.002))


@pytest.mark.parametrize("special", SPECIAL)
@pytest.mark.parametrize("hidden", HIDDEN)
def test_root_and_examples(solver, state, true_markers, hidden, special):
    observation = with_points(true_markers, hidden, special)
    expected, found = both(lambda: solver._locator.locate(state, observation))
    if expected is None or found is None or special == -1e30:
        return  # at this distance nothing is left of single precision
    assert_same_examples(found, expected)
    assert_close(found.nearest_m, expected.nearest_m)


def assert_same_examples(found: Located, expected: Located) -> None:
    assert_close(found.root.position_m, expected.root.position_m)
    assert_close(found.root.rotation, expected.root.rotation)
    assert len(found.examples.frames) == len(set(found.examples.frames.tolist())) == len(expected.examples.frames)
    assert (np.diff(found.examples.distances) >= 0.0).all()
    assert_close(found.examples.distances, expected.examples.distances)
    assert len(found.found) == len(expected.found)
    # frames of nearly the same distance may be ranked differently
    shared = np.intersect1d(found.examples.frames, expected.examples.frames)
    assert len(shared) >= 0.99 * len(found.examples.frames)
    assert found.examples.poses.shape == expected.examples.poses.shape
    same = found.examples.frames == expected.examples.frames
    np.testing.assert_array_equal(found.examples.poses[same], expected.examples.poses[same])
    np.testing.assert_array_equal(found.examples.markers_m[same], expected.examples.markers_m[same])


@pytest.fixture(scope="module", params=[8192, 150, 31, 1])
def hurried(request, solver) -> PoseSolver:
    """The solver with samples of all frames, every few, every few tens, and only the first."""
    found = copy(solver)
    found._locator = copy(solver._locator)
    found._locator.__dict__.pop("packed_hurried", None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sample, "_FRAMES", request.param)
        found._locator._sample = sample.SampleSearch(found._locator._markers)
    return found


def with_past(state: SolverState, past: str) -> SolverState:
    """Return what remains of a state if only a part of the past is known."""
    if past == "poses":
        return state
    state = replace(state, pose=None, previous_pose=None, found=None)
    return state if past == "root and markers" else replace(state, markers_m=None, root=state.root if past else None)


@pytest.mark.parametrize("special", SPECIAL)
@pytest.mark.parametrize("hidden", HIDDEN)
@pytest.mark.parametrize("past", ["", "root", "root and markers", "poses"])
def test_hurried_root_and_examples(hurried, state, true_markers, past, hidden, special):
    observation, before = with_points(true_markers, hidden, special), with_past(state, past)
    expected, found = both(lambda: hurried._locator.locate(before, observation, hurried=True))
    if special == -1e30:
        return  # at this distance nothing is left of single precision
    has_root = before.root is not None or np.count_nonzero(hurried.subject.torso & observation.located) >= 3
    assert (expected is not None) == (found is not None) == has_root
    if found is None:
        return
    if not observation.located.any():  # all frames are equally near
        np.testing.assert_array_equal(found.root.position_m, before.root.position_m)
        assert len(found.found) == len(set(found.found.tolist())) > 0
        assert np.isnan(found.nearest_m)
    else:
        assert_same_examples(found, expected)
        np.testing.assert_array_equal(found.found, expected.found)
        assert_close(found.nearest_m, expected.nearest_m)


def test_hurried_search_anywhere(hurried, state):
    """Frames around the first and the last of the database are within it; both bodies count the same distances."""
    locator, visited = hurried._locator, []
    last = len(locator._poses) - 1
    for frame in (0, 1, 40, last // 2, last - 40, last - 1, last):
        points_m = state.root.to_world(locator._markers.take(np.array([frame]))[0].astype(np.float64))
        observation = Observation.of_points(points_m)
        before = with_past(replace(state, markers_m=points_m), "root and markers")
        counts = [locator.visited]

        def located(before=before, observation=observation, counts=counts) -> Located | None:
            found = locator.locate(before, observation, hurried=True)
            counts.append(locator.visited)
            return found

        expected, found = both(located)
        assert_same_examples(found, expected)
        np.testing.assert_array_equal(found.found, expected.found)
        visited.append(np.diff(counts))
    assert (np.array(visited) == 3 * len(locator._sample)).all()


@pytest.mark.parametrize("special", [np.nan, np.inf])
def test_hurried_from_a_pose_that_is_not_finite_is_refused(hurried, state, true_markers, special):
    pose = state.pose.copy()
    pose[-1] = special
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        hurried._locator.locate(replace(state, pose=pose), with_points(true_markers, (), None), hurried=True)


@pytest.mark.parametrize("is_hurried", [False, True])
def test_frames_of_a_known_body_count_more(solver, state, true_markers, monkeypatch, is_hurried):
    factors = np.where(np.arange(len(solver._locator._poses)) % 2, 4.0, 1.0)
    locator = copy(solver._locator)
    monkeypatch.setattr(locator, "_factors", factors)
    for name in ("packed", "packed_hurried"):
        locator.__dict__.pop(name, None)
    expected, found = both(lambda: locator.locate(state, with_points(true_markers, (), None), is_hurried))
    nearest = found.examples.frames[: len(found.examples.frames) // 2]
    assert (factors[nearest] == 1.0).mean() > 0.6
    assert_same_examples(found, expected)


@pytest.mark.parametrize("special", SPECIAL)
@pytest.mark.parametrize("hidden", HIDDEN)
@pytest.mark.parametrize("past", [0, 3, SOLVED])
def test_learned_prior(solver, state, true_markers, hidden, special, past):
    prior, observed = solver.best._learned, LaggedHistory(solver.best.longest_s)
    for number, markers_m in enumerate(true_markers[SOLVED - past : SOLVED]):
        points_m = np.where(np.arange(len(markers_m))[:, None] == number % 8, np.nan, markers_m)
        observed = observed.remember(state.time_s - (past - number) / 30.0, points_m)
    observation = with_points(true_markers, hidden, special)
    single = np.arange(len(observation.points_m)) % 3 == 1
    recent = replace(prior.recent(observation, observed, state.time_s), single=single)
    expected, found = both(lambda: prior.estimate(recent, state.root))
    if special == -1e30 and expected is not None and found is not None:
        assert np.isfinite(found.pose.covariance).all() == np.isfinite(expected.pose.covariance).all()
        return
    assert_close(found.pose.mean, expected.pose.mean)
    assert_close(found.pose.covariance, expected.pose.covariance)
    assert_close(found.root.rotation, expected.root.rotation)
    assert_close(found.root.position_m, expected.root.position_m)
    assert_close(found.root_sigma, expected.root_sigma)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("is_known", [False, True])
@pytest.mark.parametrize("without", ["nothing", "learned prior", "last poses", "markers"])
def test_estimate(solver, state, true_markers, stage_rig, seed, is_known, without):
    generator = np.random.default_rng(seed)
    hidden = 1.0 if without == "markers" else 0.3
    observation = seen_by(stage_rig.cameras[0], generator, true_markers[SOLVED], hidden, 0.3, 0.3)
    before = replace(state, pose=None, previous_pose=None) if without == "last poses" else state
    with body(False):
        located = solver._locator.locate(state, Observation.of_points(true_markers[SOLVED]))
        recent = solver.best._learned.recent(observation, state.observed, state.time_s)
        learned = solver.best._learned.estimate(recent, located.root)
    problem = FrameProblem(before, observation, located.root, located.examples)
    model = replace(solver.best.model, is_known=is_known)
    given = None if without == "learned prior" else learned
    expected, found = both(lambda: best_estimate(model, problem, given))
    for name in ("pose", "uncertainty_rad"):
        assert_close(getattr(found, name), getattr(expected, name))
    assert_close(found.root.position_m, expected.root.position_m)
    assert_close(found.root.rotation, expected.root.rotation)
    assert_close(found.tilt_rad, expected.tilt_rad)
    assert_close(found.expectation.prior.mean, expected.expectation.prior.mean)
    assert_close(found.expectation.prior.covariance, expected.expectation.prior.covariance)
    assert_close(found.expectation.root_sigma, expected.expectation.root_sigma)
    assert (found.neighbours, found.prior_led) == (expected.neighbours, expected.prior_led)


@pytest.mark.parametrize("special", [np.nan, np.inf, 1e200])
@pytest.mark.parametrize("place", ["distances", "poses", "learned mean", "learned covariance", "last pose"])
def test_an_estimate_from_what_is_not_finite(solver, state, true_markers, special, place):
    """Whatever comes, no memory is left, and what is returned is refused or not finite where NumPy's is."""
    with body(False):
        located = solver._locator.locate(state, Observation.of_points(true_markers[SOLVED]))
        recent = solver.best._learned.recent(Observation.of_points(true_markers[SOLVED]), state.observed, state.time_s)
        learned = solver.best._learned.estimate(recent, located.root)
    examples, before, spoils = located.examples, state, float(special)
    if place in ("distances", "poses"):
        values = getattr(examples, place).copy()
        with np.errstate(over="ignore"):
            values.flat[7] = spoils
        examples = replace(examples, **{place: values})
    elif place == "last pose":
        pose = state.pose.copy()
        pose[4] = spoils
        before = replace(state, pose=pose)
    else:
        mean, covariance = (each.copy() for each in learned.pose)
        (mean if place == "learned mean" else covariance).flat[0] = spoils
        learned = replace(learned, pose=type(learned.pose)(mean, covariance))
    observation = Observation.of_points(true_markers[SOLVED], np.full(8, 0.002))
    problem = FrameProblem(before, observation, located.root, examples)
    expected, found = both(lambda: best_estimate(solver.best.model, problem, learned))
    if expected is not None and found is not None and np.isfinite(expected.pose).all():
        assert np.isfinite(found.pose).all()


def test_an_example_outside_the_database_is_refused(solver, state, true_markers):
    observation = Observation.of_points(true_markers[SOLVED])
    located = solver._locator.locate(state, observation)
    frames = located.examples.frames.copy()
    frames[3] = len(solver._locator._poses)
    problem = FrameProblem(state, observation, located.root, replace(located.examples, frames=frames))
    with pytest.raises(IndexError, match="outside"):
        best_estimate(solver.best.model, problem, None)
