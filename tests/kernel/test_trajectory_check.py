"""Search in a sample and distances of recent markers by the kernel are those of NumPy, within rounding."""

import numpy as np
import pytest
from perfanim.core.kernel.library import use_kernel
from perfanim.core.solver.database_markers import DatabaseMarkers, database_markers
from perfanim.core.solver.lagged_history import LaggedFrames, LaggedHistory, LaggedMarkers
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.root import root_from_torso
from perfanim.core.solver.search import sample as sample_module
from perfanim.core.solver.search.exhaustive import Query
from perfanim.core.solver.search.sample import SampleSearch, nearest_in_sample
from perfanim.core.solver.solution import SolverState
from perfanim.core.solver.trajectory_check import TrajectoryCheck, trajectory_distances
from two_bodies import assert_same, spoiled

EPSILON = float(np.finfo(np.float32).eps)
LAGS_S = (0.1, 0.25, 0.6)
SAMPLES = [8192, 300, 1]  # largest sample: all frames of the small database, every few, only the first
SPECIAL = [None, np.nan, np.inf, -np.inf, 1e19, 1e-40]


@pytest.fixture(scope="module")
def markers(model, database) -> DatabaseMarkers:
    return database_markers(model, database)


def sample_of(markers: DatabaseMarkers, largest: int) -> SampleSearch:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sample_module, "_FRAMES", largest)
        return SampleSearch(markers)


def exact_distances(sample: SampleSearch, markers: DatabaseMarkers, target: np.ndarray, weights: np.ndarray):
    """Return the distances (S,) of the sample's frames in double precision, infinite where they are not numbers."""
    known_m = markers.all()[:: sample.step].reshape(len(sample), -1).astype(np.float64)
    with np.errstate(all="ignore"):
        squares = np.square(known_m - target.astype(np.float64)) * weights
        return np.nan_to_num(squares.sum(axis=1), nan=np.inf, posinf=np.inf)


@pytest.mark.parametrize("special", SPECIAL)
@pytest.mark.parametrize("count", [1, 2, 7, 60, 10_000])
@pytest.mark.parametrize("largest", SAMPLES)
def test_nearest_in_sample(markers, largest, count, special):
    sample, generator = sample_of(markers, largest), np.random.default_rng(count)
    count = min(count, len(sample))
    for seed in range(20):
        frame = generator.integers(len(markers), size=1)
        target = markers.take(frame).ravel() + generator.normal(0.0, 0.05, size=3 * markers.count)
        target = spoiled(target.astype(np.float32), special, seed)
        weights = (generator.uniform(0.5, 1.0, len(target)) * (generator.uniform(size=len(target)) < 0.8)).astype("f4")
        distances = exact_distances(sample, markers, target, weights)
        nearest = np.sort(distances)[:count]
        for body in (nearest_in_sample.numpy_body, nearest_in_sample.compiled_body):
            with np.errstate(all="ignore"):
                found = body(sample, target, weights, count)
            assert found.dtype == np.int64
            assert len(set(found.tolist())) == len(found) == count
            assert (found % sample.step == 0).all()
            known = np.isfinite(nearest)
            np.testing.assert_allclose(distances[found // sample.step][known], nearest[known], rtol=50 * EPSILON)


def test_of_equal_distances_the_first_frames_are_nearest(markers):
    sample = sample_of(markers, 300)
    nothing = np.zeros(3 * markers.count, dtype=np.float32)
    found = nearest_in_sample.compiled_body(sample, nothing, nothing, 20)
    np.testing.assert_array_equal(found, sample.step * np.arange(20))


@pytest.fixture(scope="module", params=[False, True])
def check(request, database, markers) -> TrajectoryCheck:
    """A check, or its time-reversed copy."""
    earlier = LaggedMarkers(database, markers, LaggedFrames(database, LAGS_S))
    found = TrajectoryCheck(sample_of(markers, 100), markers, earlier)
    return found.backwards() if request.param else found


def recent_markers(markers: DatabaseMarkers, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return markers now and at the lags, some of them hidden, and of one lag all."""
    near = markers.take(generator.integers(len(markers), size=1 + len(LAGS_S))).astype(np.float64)
    near[generator.uniform(size=near.shape[:2]) < 0.2] = np.nan
    near[1 + generator.integers(len(LAGS_S))] = np.nan
    return near[0], near[1:]


@pytest.mark.parametrize("special", SPECIAL)
@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 300])
def test_trajectory_distances(check, markers, database, count, special):
    generator = np.random.default_rng(count)
    starts = [clip.start for clip in database.clips] + [clip.stop - 1 for clip in database.clips]
    for seed in range(4):
        now_m, before_m = recent_markers(markers, generator)
        now_m, before_m = spoiled(now_m, special, 7 * seed), spoiled(before_m, special, 11 * seed)
        frames = generator.integers(len(markers), size=count)
        frames[: len(starts)] = starts[:count]
        assert_same(trajectory_distances, check, now_m, before_m, frames, rounding=50 * EPSILON)


def test_each_frame_is_nearest_to_its_own_past(check, markers):
    frames = np.arange(0, len(markers), 7)
    for number, frame in enumerate(frames):
        earlier_m = check._earlier.of_frames(np.array([frame]))[0].astype(np.float64)
        now_m = markers.take(np.array([frame]))[0].astype(np.float64)
        distances = trajectory_distances.compiled_body(check, now_m, earlier_m, frames)
        np.testing.assert_array_equal(distances[:, number], 1e-12)
        moved_m = trajectory_distances.compiled_body(check, now_m, earlier_m + 0.5, frames)
        assert moved_m[1, number] < 1e-11 < moved_m[0, number]


def test_nothing_located_is_near_to_all(check, markers):
    unknown = np.full((1 + len(LAGS_S), markers.count, 3), np.nan)
    frames = np.arange(20)
    assert_same(trajectory_distances, check, unknown[0], unknown[1:], frames)
    assert (trajectory_distances.compiled_body(check, unknown[0], unknown[1:], frames) == 1e-12).all()


@pytest.mark.parametrize("place", [0, 9, 19])
@pytest.mark.parametrize("outside", [-1, None, 2**62])
def test_frames_outside_are_refused(check, markers, outside, place):
    now_m, before_m = recent_markers(markers, np.random.default_rng(0))
    frames = np.arange(20)
    frames[place] = len(markers) if outside is None else outside
    with pytest.raises(IndexError, match="outside"):
        trajectory_distances.compiled_body(check, now_m, before_m, frames)


def test_evidence_along_a_trajectory(check, markers, database, model, true_markers):
    state = SolverState(observed=LaggedHistory(LAGS_S[-1]))
    root, against = None, []
    examples = np.arange(0, database.frames, 40)
    for number, points_m in enumerate(true_markers):
        state = SolverState(time_s=number / database.fps, observed=state.observed)
        observation = Observation.of_points(points_m)
        root = root_from_torso(observation, markers.all().mean(axis=0), model, root)
        pair = []
        for is_compiled in (False, True):
            assert use_kernel(is_compiled) == is_compiled
            pair.append(check.evidence(state, observation, root, examples))
        np.testing.assert_allclose(pair[1], pair[0], rtol=1e-4, atol=1e-5)
        against.append(pair[1])
        observed = state.observed.remember(state.time_s, points_m)
        state = SolverState(time_s=state.time_s, observed=observed)
    assert max(against) > 0.1
    query = Query(root.to_root_frame(true_markers[-1]), None, 1.0, 0.0)
    assert len(check._sample.around(check._sample.nearest(query, 10_000))) == database.frames
