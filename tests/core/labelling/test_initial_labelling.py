"""Points of a body in poses that the database does not hold, labelled without a past."""

import numpy as np
import pytest
from perfanim.core.geometry import rotations as rot
from perfanim.core.labelling.initial_labelling import REACH_M, InitialLabeller
from perfanim.core.labelling.label_search import WORK, LabelSearch
from perfanim.core.labelling.labeller import Labeller

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
def test_any_pose_anywhere_is_labelled(labeller, true_markers, ghosts):
    generator = np.random.default_rng(ghosts)
    for row in true_markers[::6]:
        points, markers = points_of(row, generator, ghosts)
        start = labeller.label(points)
        np.testing.assert_array_equal(start.labels, markers)
        assert np.linalg.norm(start.expected_m[markers[markers >= 0]] - points[markers >= 0], axis=1).max() < REACH_M


@pytest.mark.parametrize("hidden", [(2,), (4, 7)])
def test_hidden_markers_are_borne(labeller, true_markers, hidden):
    generator = np.random.default_rng(1)
    for row in true_markers[::6]:
        shown = row.copy()
        shown[list(hidden)] = np.nan
        points, markers = points_of(shown, generator)
        np.testing.assert_array_equal(labeller.label(points).labels, markers)


def test_what_is_no_body_is_not_labelled(labeller, true_markers):
    generator = np.random.default_rng(2)
    assert labeller.label(np.empty((0, 3))) is None
    assert labeller.label(true_markers[0, :2]) is None
    assert labeller.label(generator.uniform(-5.0, 5.0, (8, 3))) is None
    row = true_markers[0].copy()
    row[[0, 1]] = np.nan  # too little of the torso
    assert labeller.label(points_of(row, generator)[0]) is None


def test_cost_tells_wrong_labels_from_right_ones(labeller, true_markers):
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


def test_labels_have_the_cost_of_their_markers(labeller, true_markers):
    generator = np.random.default_rng(3)
    for row in true_markers[::6]:
        points, _ = points_of(row, generator)
        start = labeller.label(points)
        labelled = np.full(row.shape, np.nan)
        labelled[start.labels] = points
        assert start.cost == pytest.approx(labeller.cost(labelled), rel=1e-3)


def test_a_body_that_is_followed_is_placed_with_its_shoulders_hidden(labeller, true_markers):
    row = true_markers[0]
    stooped = row.copy()
    stooped[:2] = np.nan
    assert labeller.cost(stooped, row) < labeller.cost(stooped) == np.inf
    assert labeller.cost(stooped[[0, 1, 2, 3, 6, 5, 4, 7]], row) > labeller.cost(stooped, row) + labeller.cost(row)


def test_a_search_is_spread_over_frames_and_follows_the_points(labeller, true_markers):
    """Among a crowd of ghosts it takes several frames; what it finds is about the last of them."""
    generator = np.random.default_rng(4)
    rows, ghosts = true_markers[:12], generator.uniform(-3.0, 3.0, (150, 3))
    search, work = LabelSearch(labeller, np.concatenate((rows[0], ghosts)), Labeller(range(8))), []
    piece = labeller.search(search.points_m)
    with pytest.raises(StopIteration):
        while True:
            work.append(next(piece))
    frames = 1
    while not search.advance():
        search.follow(np.concatenate((ghosts, rows[frames])), 1.0 / 60.0)
        frames += 1
    assert frames > 2
    assert max(work) < WORK  # no piece is longer than a frame's share
    assert (frames - 1) * WORK < sum(work) < frames * WORK + max(work) * frames
    labels = search.carry(search.found.labels)[1]
    np.testing.assert_array_equal(labels, np.concatenate((np.full(len(ghosts), -1), np.arange(8))))
