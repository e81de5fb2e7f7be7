"""A search for labels that is done a piece in each frame, and what it found carried to the last one."""

import numpy as np
import pytest
from perfanim.core.labelling.initial_labelling import InitialLabels
from perfanim.core.labelling.label_search import WORK, LabelSearch

POINTS_M = np.array([[0.0, 1.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.2, 0.0], [0.6, 0.3, 0.1]])
LABELS = np.array([1, 0, -1, 2])
STEP_S = 1.0 / 60.0


class Pieces:
    """Stands for an initial labeller whose search takes pieces of known work."""

    def __init__(self, work, result):
        self._work, self._result, self.done = work, result, 0

    def search(self, points_m):
        for work in self._work:
            yield work
            self.done += 1
        return self._result


def found(*alternatives):
    return InitialLabels(LABELS, 3.0, POINTS_M[:3], alternatives)


def search_of(initial):
    return LabelSearch(initial, POINTS_M, np.zeros(3, dtype=bool))


def test_search_is_spread_over_frames():
    initial = Pieces([4.0, 4.0, 4.0, 20.0, 1.0], found())
    search = search_of(initial)
    done = []
    for _ in range(2):
        assert not search.advance(10.0)
        assert search.found is None and search.labellings() == []
        done.append(initial.done)
    assert done == [2, 3]  # three pieces, the third of them begun with a rest of the share; then one longer than it
    assert search.advance(10.0)
    assert search.found.cost == 3.0
    assert search.advance(10.0)


def test_exhausted_share_starts_no_further_piece():
    initial = Pieces([4.0, 4.0, 4.0], None)
    assert not search_of(initial).advance(8.0)
    assert initial.done == 1  # the second piece is what it waits after


def test_labellings_are_the_best_and_its_alternatives():
    alternative = (np.array([0, 1, -1, 2]), 5.0)
    search = search_of(Pieces([], found(alternative)))
    assert search.advance(WORK)
    (labels, cost), other = search.labellings()
    np.testing.assert_array_equal(labels, LABELS)
    assert cost == 3.0
    assert other is alternative


def test_points_unlike_a_body_have_no_labellings():
    search = search_of(Pieces([1.0], None))
    assert search.advance(WORK)
    assert search.labellings() == []


@pytest.mark.parametrize("frames", [0, 1, 8])
def test_labels_are_carried_to_the_last_frame(frames):
    search, generator = search_of(Pieces([], found())), np.random.default_rng(1)
    order = np.arange(4)
    for frame in range(1, frames + 1):
        order = generator.permutation(4)
        search.follow((POINTS_M + frame * np.array([0.12, 0.0, 0.0]))[order], STEP_S)
    labeller, labels = search.carry(LABELS)
    np.testing.assert_array_equal(labels, LABELS[order])
    now = POINTS_M + (frames + 1) * np.array([0.12, 0.0, 0.0])
    np.testing.assert_array_equal(labeller.follow(now, STEP_S), LABELS)
