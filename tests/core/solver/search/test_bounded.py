import numpy as np
import pytest
from perfanim.core.solver.search.bounded import BoundedSearch
from perfanim.core.solver.search.exhaustive import ExhaustiveSearch, Query

MARKERS, ANGLES, WANTED = 7, 84, 60
WEIGHTS = (0.8, 0.2)


@pytest.fixture(scope="module")
def data():
    """Return markers and poses of a wandering motion: near frames are alike, as in recordings."""
    generator = np.random.default_rng(0)
    courses = np.cumsum(generator.normal(scale=0.05, size=(5000, 12)), axis=0)
    poses = courses @ generator.normal(scale=0.2, size=(12, ANGLES)) + generator.normal(scale=0.01, size=(5000, ANGLES))
    markers = courses @ generator.normal(scale=0.1, size=(12, 3 * MARKERS))
    return markers.reshape(-1, MARKERS, 3).astype(np.float32), poses.astype(np.float32)


def query(data, frame, hidden=(), pose=True, away=0.02):
    generator = np.random.default_rng(frame)
    markers = data[0][frame] + generator.normal(scale=away, size=(MARKERS, 3))
    markers[list(hidden)] = np.nan
    return Query(markers, data[1][frame] + generator.normal(scale=away, size=ANGLES) if pose else None, *WEIGHTS)


def same(data, search, asked, start=None):
    exhaustive = ExhaustiveSearch(*data)
    frames, distances = search.nearest(asked, WANTED, start)
    expected = np.sort(exhaustive.distances(asked, np.arange(len(data[1]))))[:WANTED]
    # float32 of values up to 100: differences below 1e-4 are rounding
    np.testing.assert_allclose(distances, expected, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(exhaustive.distances(asked, frames), expected, rtol=1e-5, atol=1e-4)
    assert len(set(frames)) == WANTED
    return frames


@pytest.mark.parametrize("hidden", [(), (3,), (0, 1, 6), tuple(range(MARKERS))])
@pytest.mark.parametrize("away", [0.02, 2.0])
def test_closest_frames_are_those_of_the_exhaustive_search(data, hidden, away):
    search = BoundedSearch(*data)
    for frame in range(0, 5000, 500):
        same(data, search, query(data, frame, hidden, away=away))


def test_the_frames_found_before_change_nothing(data):
    search, start = BoundedSearch(*data), None
    for frame, hidden in ((1234, ()), (1235, (2,)), (1240, ()), (4000, (2, 4)), (4001, (4,))):
        start = same(data, search, query(data, frame, hidden), start)
    for few in (np.empty(0, dtype=np.int64), np.arange(WANTED - 1)):
        same(data, search, query(data, 1234), few)


def test_frames_near_an_earlier_query_are_enough_while_a_motion_goes_on(data):
    search, start, looked = BoundedSearch(*data), None, []
    near_frames = search._near_frames
    search._near_frames = lambda *given: looked.append(given[0]) or near_frames(*given)
    for frame in range(1000, 1100):
        start = same(data, search, query(data, frame, away=0.002), start)
    assert 0 < len(looked) < 50
    for weights in ((0.4, 0.2), (0.8, 0.6)):  # another measure needs new bounds
        asked = query(data, 1100)
        same(data, search, Query(asked.markers_m, asked.pose, *weights), start)


def test_without_a_pose_it_is_the_exhaustive_search(data):
    asked = query(data, 77, pose=False)
    mine, theirs = (kind(*data).nearest(asked, WANTED)[0] for kind in (BoundedSearch, ExhaustiveSearch))
    np.testing.assert_array_equal(mine, theirs)


def test_most_poses_are_left_out(data):
    search, looked = BoundedSearch(*data), []
    distances = search._frames.distances
    search._frames.distances = lambda asked, frames: looked.append(len(frames)) or distances(asked, frames)
    for frame in range(0, 5000, 500):
        search.nearest(query(data, frame), WANTED)
    assert max(looked) < 0.1 * len(data[1])


def test_more_than_there_is(data):
    frames, _ = BoundedSearch(data[0][:20], data[1][:20]).nearest(query(data, 3), 100)
    assert sorted(frames) == list(range(20))
