"""Points of a body in poses that the database does not hold, labelled without a past."""

import numpy as np
import pytest
from perfanim.core.geometry import rotations as rot
from perfanim.core.labelling.initial_labelling import REACH_M, InitialLabeller
from perfanim.core.labelling.label_search import WORK, LabelSearch

NOISE_M = 0.002


@pytest.fixture(scope="module")
def labeller(model, database):
    frames = np.arange(0, database.frames, 2)
    ups = rot.rotate(rot.conjugate(database.root_rotations[frames]), np.array([0.0, 1.0, 0.0]))
    return InitialLabeller(model.database_markers(database, frames), ups.astype(np.float32), model.torso)


def points_of(row, generator, ghosts=0):
    """Markers (M, 3) moved, turned as far as cameras see them, with noise, ghosts, in any order; and which they are."""
    turned = rot.rotate(rot.from_rotation_vector([0.0, generator.uniform(-1.5, 1.5), 0.0]), row)
    turned = turned + np.array([generator.uniform(-2.0, 2.0), 0.0, generator.uniform(-2.0, 2.0)])
    seen = np.flatnonzero(np.isfinite(row[:, 0]))
    away = generator.choice([-1.0, 1.0], (ghosts, 3)) * generator.uniform(0.7, 1.5, (ghosts, 3))
    points = np.concatenate((turned[seen], np.nanmean(turned, axis=0) + away))
    points += generator.normal(scale=NOISE_M, size=points.shape)
    order = generator.permutation(len(points))
    return points[order], np.concatenate((seen, np.full(ghosts, -1)))[order]


@pytest.mark.parametrize("ghosts", [0, 3])
def test_any_pose_at_any_place_is_labelled(labeller, true_markers, ghosts):
    generator = np.random.default_rng(ghosts)
    for row in true_markers[::6]:
        points, markers = points_of(row, generator, ghosts)
        start = labeller.label(points)
        np.testing.assert_array_equal(start.labels, markers)
        assert np.linalg.norm(start.expected_m[markers[markers >= 0]] - points[markers >= 0], axis=1).max() < REACH_M


@pytest.mark.parametrize("hidden", [(2,), (4, 7)])
def test_hidden_markers_are_tolerated(labeller, true_markers, hidden):
    generator = np.random.default_rng(1)
    for row in true_markers[::6]:
        shown = row.copy()
        shown[list(hidden)] = np.nan
        points, markers = points_of(shown, generator)
        np.testing.assert_array_equal(labeller.label(points).labels, markers)


def test_points_unlike_a_body_are_not_labelled(labeller, true_markers):
    generator = np.random.default_rng(2)
    assert labeller.label(np.empty((0, 3))) is None
    assert labeller.label(true_markers[0, :2]) is None
    assert labeller.label(generator.uniform(-5.0, 5.0, (8, 3))) is None
    row = true_markers[0].copy()
    row[[0, 1]] = np.nan  # too little of the torso
    assert labeller.label(points_of(row, generator)[0]) is None


def test_wrong_labels_cost_more(labeller, true_markers):
    row = true_markers[0]
    right = labeller.cost(row)
    assert labeller.cost(row[[1, 0, 3, 2, 5, 4, 7, 6]]) > 2.0 * right  # left for right
    assert labeller.cost(row[[0, 1, 2, 3, 6, 5, 4, 7]]) > 2.0 * right  # a hand for a foot
    assert labeller.cost(row, ghosts=2) == pytest.approx(right + 2.0 * (labeller.cost(row, ghosts=1) - right))
    hidden = row.copy()
    hidden[5] = np.nan
    assert labeller.cost(hidden) > right
    hidden[[0, 7]] = np.nan
    assert right < labeller.cost(hidden) < np.inf  # a marker of the torso among those not seen
    hidden[:3] = np.nan
    assert labeller.cost(hidden) == np.inf  # nothing tells where the body is


def test_cost_of_labels_equals_that_of_their_markers(labeller, true_markers):
    generator = np.random.default_rng(3)
    for row in true_markers[::6]:
        points, _ = points_of(row, generator)
        start = labeller.label(points)
        labelled = np.full(row.shape, np.nan)
        labelled[start.labels] = points
        assert start.cost == pytest.approx(labeller.cost(labelled), rel=1e-3)


def test_tracked_body_places_the_torso_with_hidden_shoulders(labeller, true_markers):
    row = true_markers[0]
    stooped = row.copy()
    stooped[:2] = np.nan
    assert labeller.cost(stooped, row) < labeller.cost(stooped) == np.inf
    assert labeller.cost(stooped[[0, 1, 2, 3, 6, 5, 4, 7]], row) > labeller.cost(stooped, row) + labeller.cost(row)


def test_a_search_is_spread_over_frames_and_follows_the_points(labeller, true_markers):
    """Among a crowd of ghosts it takes several frames; what it finds is about the last of them."""
    generator = np.random.default_rng(4)
    rows, ghosts = true_markers[:12], generator.uniform(-3.0, 3.0, (150, 3))
    search, work = LabelSearch(labeller, np.concatenate((rows[0], ghosts)), np.zeros(8, dtype=bool)), []
    piece = labeller.search(search.points_m)
    with pytest.raises(StopIteration):
        while True:
            work.append(next(piece))
    frames = 1
    while not search.advance(WORK):
        search.follow(np.concatenate((ghosts, rows[frames])), 1.0 / 60.0)
        frames += 1
    assert frames > 2
    assert max(work) < WORK  # no piece is longer than a frame's share
    assert (frames - 1) * WORK < sum(work) < frames * WORK + max(work) * frames
    labels = search.carry(search.found.labels)[1]
    np.testing.assert_array_equal(labels, np.concatenate((np.full(len(ghosts), -1), np.arange(8))))


# A body of one pose: four markers on the torso, two hands and a foot, so that every cost is known.
TORSO_M = np.array([[0.0, 0.5, 0.15], [-0.2, 0.4, 0.0], [0.2, 0.4, 0.0], [0.05, 0.0, 0.15]])
LIMBS_M = np.array([[-0.6, 0.1, 0.2], [0.6, 0.15, 0.2], [0.1, -0.8, 0.1]])
MISSED, GHOST, BACK = 6.0, 4.0, 6.0
TORSO_SIGMA_M, LIMB_SIGMA_M = 0.05, 0.1
LEAST_LIKELIHOOD = 1e-9


def lone_example(limbs=LIMBS_M, up=(0.0, 1.0, 0.0)):
    """The labeller of one example, and its markers."""
    markers = np.concatenate((TORSO_M, limbs))
    ups = np.array([up], dtype=np.float32)
    return InitialLabeller(markers[None].astype(np.float32), ups, np.arange(len(markers)) < 4), markers


def laid(markers, turn=(0.0, 0.0, 0.0)):
    return rot.rotate(rot.from_rotation_vector(np.array(turn)), markers) + np.array([1.0, 0.9, -3.0])


def limb_cost(*distances_m):
    return 4.0 * np.log1p(np.square(distances_m) / (8.0 * LIMB_SIGMA_M**2)).sum()


def test_costs_of_ghosts_and_hidden_markers():
    labeller, markers = lone_example()
    here = laid(markers)
    assert labeller.cost(here) == pytest.approx(0.0, abs=1e-4)
    assert labeller.cost(here, ghosts=3) == pytest.approx(3.0 * GHOST, abs=1e-4)
    for hidden, cost in (((3,), MISSED), ((5,), MISSED), ((4, 6), 2.0 * MISSED), ((0, 5), 2.0 * MISSED)):
        there = here.copy()
        there[list(hidden)] = np.nan
        assert labeller.cost(there) == pytest.approx(cost, abs=1e-4)


def test_limb_costs_are_heavy_tailed_and_torso_costs_quadratic():
    labeller, markers = lone_example()
    here = laid(markers)
    for away_m in (0.05, 0.1, 0.4):
        there = here.copy()
        there[4, 0] -= away_m
        there[6, 1] += 0.5 * away_m
        assert labeller.cost(there) == pytest.approx(limb_cost(away_m, 0.5 * away_m), rel=1e-3)
    for width_m in (0.02, 0.04):  # both sides as far out: the fit does not move
        there = here.copy()
        there[1, 0] -= width_m
        there[2, 0] += width_m
        turned_and_shifted = labeller.cost(there)
        assert turned_and_shifted == pytest.approx(width_m**2 / TORSO_SIGMA_M**2, rel=0.02)


def test_limb_costs_are_bounded():
    labeller, markers = lone_example()
    there = laid(markers)
    there[4:] += [0.0, 50.0, 0.0]
    assert labeller.cost(there) == pytest.approx(-3.0 / 2.0 * np.log(LEAST_LIKELIHOOD), rel=1e-4)


def test_facing_away_and_leaning_cost():
    labeller, markers = lone_example()
    assert labeller.cost(laid(markers, (0.0, np.pi, 0.0))) == pytest.approx(BACK, abs=1e-3)
    assert labeller.cost(laid(markers, (0.0, -np.pi / 2.0, 0.0))) == pytest.approx(0.5 * BACK, abs=1e-3)
    lean = 0.3  # aside, so that it still faces the cameras; its tail is heavy, too
    expected = 2.0 * np.log1p((1.0 - np.cos(lean)) / (2.0 * 0.25**2))
    assert labeller.cost(laid(markers, (0.0, 0.0, lean))) == pytest.approx(expected, rel=1e-2)
    tilted, markers = lone_example(up=(np.sin(lean), np.cos(lean), 0.0))  # who is known to lean
    assert tilted.cost(laid(markers, (0.0, 0.0, lean))) == pytest.approx(0.0, abs=1e-3)
    assert tilted.cost(laid(markers)) == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("limbs", [0, 1, 2])
def test_bodies_with_few_or_no_limbs_are_labelled(limbs):
    labeller, markers = lone_example(LIMBS_M[:limbs])
    order = np.random.default_rng(limbs).permutation(len(markers))
    start = labeller.label(laid(markers, (0.0, 0.5, 0.0))[order])
    np.testing.assert_array_equal(start.labels, order)
    np.testing.assert_allclose(start.expected_m[order], laid(markers, (0.0, 0.5, 0.0))[order], atol=1e-5)
    assert labeller.cost(laid(markers)) == pytest.approx(0.0, abs=1e-3)


def test_alternatives_are_distinct_and_cost_more():
    """A point 6 cm from the hand's and one at the foot's, which is hidden: the likeliest first, with their costs."""
    labeller, markers = lone_example()
    points = np.concatenate((laid(markers), laid(markers)[4:5] + np.array([0.0, 0.06, 0.0])))
    start = labeller.label(points)
    assert start.labels.tolist() == [0, 1, 2, 3, 4, 5, 6, -1]
    assert start.cost == pytest.approx(GHOST, abs=1e-3)
    costs = [cost for _, cost in start.alternatives]
    assert costs == sorted(costs)
    assert len({tuple(labels) for labels, _ in start.alternatives}) == len(costs) == 5
    labels, cost = start.alternatives[0]
    assert labels.tolist() == [0, 1, 2, 3, -1, 5, 6, 4]
    assert cost == pytest.approx(GHOST + limb_cost(0.06), rel=1e-3)


def test_body_is_found_among_many_points():
    """Twenty points about each limb: more than are tried, of which the nearest are kept."""
    labeller, markers = lone_example()
    generator = np.random.default_rng(5)
    here = laid(markers, (0.0, -0.4, 0.0))
    crowd = np.repeat(here[4:], 20, axis=0) + generator.choice([-1.0, 1.0], (60, 3)) * generator.uniform(
        0.15, 0.4, (60, 3)
    )
    order = generator.permutation(len(here) + len(crowd))
    start = labeller.label(np.concatenate((here, crowd))[order])
    np.testing.assert_array_equal(start.labels, np.where(order < len(here), order, -1))
    assert start.cost == pytest.approx(len(crowd) * GHOST, rel=1e-3)


def test_distant_points_are_not_limbs():
    labeller, markers = lone_example()
    here = laid(markers)
    there = np.delete(here, 6, axis=0)
    far_off = np.concatenate((there, here[6:] - [0.0, 1.0, 0.0]))
    near = np.concatenate((there, here[6:] - [0.0, 0.2, 0.0]))
    assert labeller.label(far_off).labels.tolist() == [0, 1, 2, 3, 4, 5, -1]
    assert labeller.label(near).labels.tolist() == [0, 1, 2, 3, 4, 5, 6]


def test_too_few_or_unlikely_markers_are_refused():
    labeller, markers = lone_example()
    here = laid(markers)
    assert labeller.label(here[:5]).labels.tolist() == [0, 1, 2, 3, 4]  # five of seven
    assert labeller.label(here[:4]) is None
    spread = here.copy()
    spread[:4] += [[0.0, 0.08, 0.0], [-0.08, 0.0, 0.0], [0.08, 0.0, 0.0], [0.0, -0.08, 0.0]]
    spread[4:] += [[-0.4, 0.3, 0.0], [0.3, 0.4, 0.0], [0.3, -0.3, 0.0]]
    assert labeller.label(spread) is None
