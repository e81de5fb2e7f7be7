"""The whole solver on markers of a clip that is not in the database."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.body.pose_notes import NoteKind
from perfanim.core.body.standard_skeleton import scaled
from perfanim.core.errors import DatabaseError
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.settings import METHODS, BestSettings, LocalPcaSettings, SolveSettings
from perfanim.core.solver.solution import Solution
from perfanim.core.solver.subject_model import ROOT_AT_REST, SubjectModel

NOISE_M = 0.002
HAND = 4  # LHAN of locomotion


@pytest.fixture(scope="module")
def noisy(true_markers):
    return true_markers + np.random.default_rng(0).normal(scale=NOISE_M, size=true_markers.shape)


def solve(model, database, observations, method="best", prior_share=1.0):
    settings = SolveSettings(method=method, best=BestSettings(prior_share=prior_share))
    return follow(PoseSolver(model, database, settings), observations)[0]


def follow(solver, observations, state=None):
    """Solutions of observations in order, and the state after the last."""
    state, solutions = state or solver.initial_state, []
    for observation in observations:
        solution, state = solver.step(state, observation)
        solutions.append(solution)
    return solutions, state


def degrees_per_joint(model, solutions, truth, joints=slice(1, None), start=0):
    local = np.array([model.rotations(solution.pose, solution.root) for solution in solutions])
    return float(np.degrees(rot.angle_between(local, truth.rotations))[start:, joints].mean())


@pytest.fixture(scope="module")
def solved(model, database, noisy):
    observations = [Observation.of_points(row) for row in noisy]
    return {method: solve(model, database, observations, method) for method in METHODS}


def errors_without(embedded_motion, name, path, database_of):
    """Degrees per joint of every method on a clip that the database lacks; the learned prior has seen it."""
    database = database_of(path, [motion for other, motion in embedded_motion.items() if other != name])
    truth = sliced(embedded_motion[name], 20, 60)
    subject = Subject(name, truth.skeleton, load_marker_set("locomotion"))
    take, _ = simulate_markers(truth, subject, 1e3 * NOISE_M)
    observations = [Observation.of_points(row) for row in take.positions_m]
    model = SubjectModel(subject, database.mean_rotations)
    return {m: degrees_per_joint(model, solve(model, database, observations, m, 0.0), truth) for m in METHODS}


def test_methods_are_ordered_by_accuracy(embedded_motion, tmp_path, database_of):
    """Interpolating beats copying, and conditioning on the markers beats both, over people whose style nobody shares.

    Where the database holds the same style again the closest frame is hard to beat, and with a single other clip of
    the behaviour there is no neighbourhood to learn from: such clips say little about the methods.
    """
    clips = ("walking-02-energetic", "running-02-neutral", "boxing-02-tired")
    rows = [errors_without(embedded_motion, name, tmp_path / "rest.db", database_of) for name in clips]
    error = {method: np.mean([row[method] for row in rows]) for method in METHODS}
    assert error["best"] < 0.95 * min(error["local-pca"], error["lwr"])
    assert max(error["local-pca"], error["lwr"]) < 0.97 * error["nearest"]
    for row in rows:
        assert row["best"] == min(row.values())


def test_only_fitting_methods_explain_the_markers(solved, noisy):
    def rms(method):
        markers = np.array([solution.markers_m for solution in solved[method]])
        return np.sqrt(np.mean(np.sum((markers - noisy) ** 2, axis=-1)))

    assert rms("best") < 2.0 * np.sqrt(3.0) * NOISE_M
    assert rms("best") < rms("local-pca") < rms("nearest")


def test_solution_is_consistent(model, solved):
    for method, solutions in solved.items():
        for solution in solutions[::20]:
            np.testing.assert_allclose(
                model.markers(solution.pose, solution.root), solution.markers_m, atol=1e-6, err_msg=method
            )
            assert solution.nearest_m > 0.0
    assert {solution.neighbours for solution in solved["nearest"]} == {1}
    sizes = {(solution.neighbours, solution.dimensions) for solution in solved["local-pca"]}
    settings = LocalPcaSettings()
    assert sizes <= {(k, b) for k in settings.neighbours for b in settings.dimensions}
    assert len(sizes) > 1  # chosen anew for every frame


def test_the_root_is_found(solved, truth):
    for solution, position, rotation in zip(solved["best"], truth.root_positions_m, truth.rotations, strict=True):
        assert np.linalg.norm(solution.root.position_m - position) < 0.05
        assert np.degrees(rot.angle_between(solution.root.rotation, rotation[0])) < 10.0


@pytest.mark.parametrize("method", METHODS)
def test_hidden_markers_are_tolerated(model, database, noisy, truth, solved, method):
    points = noisy[:30].copy()
    points[10:20, [HAND, 6]] = np.nan
    points[20:, 1] = np.nan
    points[25] = np.nan  # nothing at all
    solutions = solve(model, database, [Observation.of_points(row) for row in points], method)
    part = sliced(truth, 0, 30)
    assert all(np.isfinite(solution.pose).all() for solution in solutions)
    all_seen = degrees_per_joint(model, solved[method][:30], part)
    assert degrees_per_joint(model, solutions, part) < all_seen + 6.0


def test_nothing_is_solved_without_torso(model, database, noisy):
    solver = PoseSolver(model, database, SolveSettings())
    hands_only = noisy[0].copy()
    hands_only[model.torso] = np.nan
    none, state = solver.step(solver.initial_state, Observation.of_points(hands_only))
    assert none is None
    assert state.markers_m is None
    first, state = solver.step(state, Observation.of_points(noisy[0]))
    np.testing.assert_allclose(state.markers_m, first.markers_m)
    assert solver.step(state, Observation.of_points(hands_only))[0] is not None
    assert solver.initial_state.markers_m is None


def test_closest_distance_leaves_the_state_unchanged(model, database, noisy):
    solver = PoseSolver(model, database, SolveSettings(search="exhaustive"))
    _, state = follow(solver, [Observation.of_points(row) for row in noisy[:5]])
    before, rootless = state.markers_m.copy(), replace(solver.initial_state, root=state.root)
    frame = database.frames // 2  # another clip than the walk that is followed
    seen = Observation.of_points(model.database_markers(database, np.array([frame]))[0].astype(np.float64))
    known_m = solver.closest_m(rootless, seen)
    assert known_m < 0.01  # the root lies where several examples' torsos have it, which differ by less
    assert solver.closest_m(rootless, Observation.of_points(noisy[5])) > 2.0 * known_m  # not in the database
    np.testing.assert_array_equal(state.markers_m, before)
    hands_only = noisy[0].copy()
    hands_only[model.torso] = np.nan
    fresh = PoseSolver(model, database, SolveSettings())
    assert np.isnan(fresh.closest_m(fresh.initial_state, Observation.of_points(hands_only)))


def test_start_at_a_known_torso_finds_nearer_examples(model, database):
    """Other labels of the limbs are judged at the root of the present pose: a bent trunk misleads a first one."""
    solver = PoseSolver(model, database, SolveSettings())
    frames = np.arange(0, database.frames, database.frames // 100)
    away_m = []
    for markers_m, pose in zip(
        model.database_markers(database, frames).astype(float), database.poses[frames], strict=True
    ):
        seen = Observation.of_points(markers_m)
        solution = Solution(pose, ROOT_AT_REST, markers_m, 1, 0, 0.0, 0)
        starts = (solver.initial_state, solver.begin_at_torso(solution))
        away_m.append([solver.closest_m(start, seen) for start in starts])
    fresh_m, at_torso_m = np.array(away_m).T
    assert at_torso_m.mean() < 0.8 * fresh_m.mean()
    assert np.all(at_torso_m < fresh_m + 0.01)


def test_searches_per_frame_are_bounded(model, database, noisy, monkeypatch):
    """Every second frame jumps; the past is looked beyond now and then only, and looks search a sample only."""
    solver = PoseSolver(model, database, SolveSettings(search="exhaustive"))
    search, searches = solver._locator.search.nearest, []
    monkeypatch.setattr(solver._locator.search, "nearest", lambda *query: searches.append(1) or search(*query))
    other = model.database_markers(database, np.arange(database.frames // 2, database.frames // 2 + 30))
    jumping = np.where(np.arange(30)[:, None, None] % 2, noisy[:30], other + noisy[:1, :1] - other[:1, :1])
    state, reinitialised, counts = solver.initial_state, [], []
    for row in (*noisy[:5], *jumping):
        searches.clear()
        solution, state = solver.step(state, Observation.of_points(row))
        reinitialised.append(solution.reinitialised)
        counts.append(len(searches))
    assert any(reinitialised)
    assert not any(reinitialised[:5])
    assert set(counts[1:]) == {1}


def test_hurried_first_frame_is_nearly_as_accurate(model, database, noisy, truth):
    solver = PoseSolver(model, database, SolveSettings(search="exhaustive"))
    errors = []
    for hurried in (False, True):
        solutions = [
            solver.step(solver.initial_state, Observation.of_points(row), hurried=hurried)[0] for row in noisy[::8]
        ]
        errors.append(degrees_per_joint(model, solutions, resampled(truth, truth.fps / 8)))
    assert errors[1] < 1.3 * errors[0]


def test_initial_state_has_no_history(model, database, noisy):
    solver = PoseSolver(model, database, SolveSettings())
    observations = [Observation.of_points(row) for row in noisy[:4]]
    fresh, state = follow(solver, observations)
    solver.step(state, Observation.of_points(noisy[40]))
    again, _ = follow(solver, observations)
    np.testing.assert_array_equal([s.pose for s in again], [s.pose for s in fresh])


def test_state_continues_in_another_solver(model, database, noisy):
    """Long enough that the past counts."""
    first, second = (PoseSolver(model, database, SolveSettings(search="exhaustive")) for _ in range(2))
    _, state = follow(first, [Observation.of_points(row) for row in noisy[:20]])
    rest = [Observation.of_points(row) for row in noisy[20:22]]
    theirs, ours = follow(second, rest, state)[0], follow(first, rest, state)[0]
    np.testing.assert_array_equal([s.pose for s in theirs], [s.pose for s in ours])


def test_pose_is_independent_of_the_place(model, database, noisy, solved):
    """The body turned and moved: only the root changes."""
    turn, shift = rot.from_rotation_vector([0.0, 2.0, 0.0]), np.array([3.0, 0.5, -7.0])
    moved = solve(model, database, [Observation.of_points(rot.rotate(turn, row) + shift) for row in noisy[:5]])
    for solution, original in zip(moved, solved["best"], strict=False):
        np.testing.assert_allclose(solution.pose, original.pose, atol=1e-3)  # float32 in the search
        expected = rot.rotate(turn, original.root.position_m) + shift
        np.testing.assert_allclose(solution.root.position_m, expected, atol=1e-3)


def test_own_frames_are_preferred(embedded_motion, tmp_path, database_of):
    """The same walk stands in the database twice, once on another body; markers of the third body fit both."""
    walk = sliced(embedded_motion["walking-01-neutral"], 0, 120)
    own, other = replace(walk, name="anna"), replace(walk, name="ben", skeleton=scaled(walk.skeleton, 1.01))
    database = database_of(tmp_path / "two.db", [other, own])
    subject = Subject("anna", scaled(walk.skeleton, 0.99), load_marker_set("locomotion"))
    markers = simulate_markers(replace(walk, skeleton=subject.skeleton), subject)[0].positions_m[40]
    model = SubjectModel(subject, database.mean_rotations)
    shares = {}
    for factor in (1.0, 4.0):
        solver = PoseSolver(model, database, SolveSettings(best=BestSettings(neighbours=60, others_distance=factor)))
        found = solver._locator.locate(solver.initial_state, Observation.of_points(markers))
        shares[factor] = float(np.mean(found.examples.frames >= walk.frames))
        assert np.all(np.diff(found.examples.distances) >= 0.0)
    assert shares[1.0] == pytest.approx(0.5, abs=0.05)
    assert shares[4.0] > 0.6


@pytest.mark.parametrize("method", METHODS)
def test_small_databases_work(model, noisy, embedded_motion, tmp_path, database_of, method):
    walk = next(motion for name, motion in embedded_motion.items() if name.startswith("walking"))
    small = database_of(tmp_path / "two.db", [sliced(walk, 0, 2)])
    own = type(model)(model.subject, small.mean_rotations)
    for solution in solve(own, small, [Observation.of_points(row) for row in noisy[:3]], method):
        assert np.isfinite(solution.pose).all()
    single = database_of(tmp_path / "one.db", [sliced(walk, 0, 1)])
    with pytest.raises(DatabaseError, match="fewer than two frames; import more motion"):
        PoseSolver(own, single, SolveSettings(method=method))


@pytest.mark.parametrize("method", ["nearest", "lwr"])
def test_methods_without_fit_are_not_reinitialised(model, database, noisy, method, monkeypatch):
    monkeypatch.setattr(PoseSolver, "reinitialise", lambda *arguments: pytest.fail("solved again"))
    assert all(solve(model, database, [Observation.of_points(row) for row in noisy[:20]], method))


@pytest.mark.parametrize(("jump_m", "reasons"), [(0.0, []), (0.2, [NoteKind.NEARER_EXAMPLE]), (0.8, [NoteKind.CUT])])
def test_a_pose_is_reinitialised_after_a_jump_or_cut(model, database, noisy, monkeypatch, jump_m, reasons):
    """The past of another motion is worth nothing; limbs that only are fast still have theirs."""
    asked, original = [], PoseSolver.reinitialise

    def noted(self, *arguments):
        asked.append(arguments[4])
        return original(self, *arguments)

    solver = PoseSolver(model, database, SolveSettings())
    _, state = follow(solver, [Observation.of_points(row) for row in noisy[:20]])
    monkeypatch.setattr(PoseSolver, "reinitialise", noted)
    limbs = ~model.torso
    points = noisy[20].copy()
    points[limbs] += jump_m * np.array([0.6, 0.0, 0.8])
    solution, _ = solver.step(state, Observation.of_points(points))
    assert asked == reasons
    assert solution.begun in (None, *reasons)
    assert np.isfinite(solution.pose).all()
