import numpy as np
import pytest
from perfanim.core.solver.search.exhaustive import ExhaustiveSearch, Query

FRAMES, MARKERS, ANGLES = 700, 8, 84


@pytest.fixture(scope="module")
def data():
    generator = np.random.default_rng(0)
    markers = generator.normal(scale=0.4, size=(FRAMES, MARKERS, 3)).astype(np.float32)
    return markers, generator.normal(scale=0.5, size=(FRAMES, ANGLES)).astype(np.float32)


def query(data, hidden=(), pose=True, seed=1, weights=(0.8, 0.2)):
    generator = np.random.default_rng(seed)
    markers = data[0][300].astype(np.float64) + generator.normal(scale=0.2, size=(MARKERS, 3))
    markers[list(hidden)] = np.nan
    return Query(markers, data[1][310] + generator.normal(scale=0.2, size=ANGLES) if pose else None, *weights)


def brute_force(data, asked):
    seen = np.isfinite(asked.markers_m[:, 0])
    result = asked.marker_weight * np.sum((data[0][:, seen] - asked.markers_m[seen]) ** 2, axis=(1, 2))
    if asked.pose is not None:
        result = result + asked.pose_weight * np.sum((data[1] - asked.pose) ** 2, axis=1)
    return result


@pytest.mark.parametrize(
    ("hidden", "pose"),
    [((), True), ((), False), ((3,), True), ((3,), False), ((0, 1, 6), True), (tuple(range(MARKERS)), True)],
)
def test_closest_frames_are_those_of_brute_force(data, hidden, pose):
    search = ExhaustiveSearch(*data)
    asked = query(data, hidden, pose)
    expected = brute_force(data, asked)
    frames, distances = search.nearest(asked, 40)
    # float32 of values up to 100: differences below 1e-4 are rounding
    np.testing.assert_allclose(distances, np.sort(expected)[:40], atol=1e-4)
    np.testing.assert_allclose(expected[frames], np.sort(expected)[:40], atol=2e-4)
    assert len(set(frames)) == 40
    assert np.all(np.diff(distances) >= 0.0)


def test_hidden_markers_do_not_count(data):
    moved = data[0].copy()
    moved[:, 3] += 5.0
    asked = query(data, (3,))
    mine, theirs = (ExhaustiveSearch(m, data[1]).nearest(asked, 20)[0] for m in (data[0], moved))
    np.testing.assert_array_equal(mine, theirs)


def test_weights_choose_between_markers_and_continuity(data):
    search = ExhaustiveSearch(*data)
    assert search.nearest(query(data, weights=(1.0, 0.0)), 1)[0][0] == 300
    assert search.nearest(query(data, weights=(0.0, 1.0)), 1)[0][0] == 310


def test_nearest_among_candidates(data):
    search = ExhaustiveSearch(*data)
    asked = query(data)
    candidates = np.arange(5, FRAMES, 9)
    frames, distances = search.nearest_among(asked, candidates)
    assert sorted(frames) == candidates.tolist()
    expected = brute_force(data, asked)[candidates]
    np.testing.assert_allclose(distances, np.sort(expected), atol=1e-4)
    assert frames[0] == candidates[np.argmin(expected)]


def test_count_is_limited_to_the_database(data):
    frames, _ = ExhaustiveSearch(data[0][:5], data[1][:5]).nearest(query(data), 100)
    assert sorted(frames) == [0, 1, 2, 3, 4]
