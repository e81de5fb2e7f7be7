"""Choices of points for a torso, compared with all choices there are."""

from itertools import permutations

import numpy as np
import pytest
from perfanim.core.labelling.label_search import WORK
from perfanim.core.labelling.torso_candidates import TORSO, TorsoCandidates
from perfanim.core.markers.marker_set import FEWEST_TORSO

TORSO_M = np.array([[0.0, 0.5, 0.1], [-0.2, 0.4, 0.0], [0.2, 0.4, 0.0], [0.05, 0.0, 0.15]])
SPREAD_M, LEAST_SPREAD_M = 0.06, 0.05  # standard deviation of the examples' markers, and the least counted of distances
BEYOND_SHARE, BEYOND_M = 0.1, 0.03  # how far distances may be outside those of the examples
MOST = 4000
ROUNDING = 1e-3  # of costs of some tens in single precision


def examples(spread_m=SPREAD_M):
    return TORSO_M + np.random.default_rng(1).normal(scale=spread_m, size=(300, *TORSO_M.shape))


def choose(candidates, points_m):
    search = candidates.choose(points_m)
    while True:
        try:
            assert next(search) >= 0.0
        except StopIteration as end:
            return end.value


def spans_of(places_m):
    return np.linalg.norm(places_m[..., :, None, :] - places_m[..., None, :, :], axis=-1)


def all_choices(examples_m, points_m):
    """Every choice of points for the markers that the examples allow, with its cost."""
    of_examples = spans_of(examples_m)
    low, high = np.percentile(of_examples, (0.5, 99.5), axis=0)
    mean, sigma = of_examples.mean(axis=0), np.maximum(of_examples.std(axis=0), LEAST_SPREAD_M)
    found = {}
    count = len(TORSO_M)
    for chosen in set(permutations([*range(len(points_m)), *[-1] * (count - FEWEST_TORSO)], count)):
        seen = np.flatnonzero(np.array(chosen) >= 0)
        pair = np.ix_(seen, seen)
        spans = spans_of(points_m[np.array(chosen)[seen]])
        upper = np.triu_indices(len(seen), 1)
        fits = (spans >= low[pair] * (1.0 - BEYOND_SHARE) - BEYOND_M) & (
            spans <= high[pair] * (1.0 + BEYOND_SHARE) + BEYOND_M
        )
        if fits[upper].all():
            off = (spans - mean[pair]) / sigma[pair]
            found[chosen] = 0.5 * np.sum(off[upper] ** 2) + TORSO.missed_cost * (count - len(seen))
    return found


@pytest.mark.parametrize("spread_m", [SPREAD_M, 0.001])
def test_all_allowed_choices_are_found_likeliest_first(spread_m):
    generator = np.random.default_rng(2)
    examples_m = examples(spread_m)
    points_m = np.concatenate(
        (TORSO_M + generator.normal(scale=0.03, size=(4, 3)), generator.uniform(-0.4, 0.6, (4, 3)))
    )
    points_m = points_m[generator.permutation(8)] + np.array([2.0, 1.0, -3.0])
    expected = all_choices(examples_m, points_m)
    found = [tuple(row) for row in choose(TorsoCandidates(examples_m), points_m).tolist()]
    assert len(found) == len(set(found)) > 5
    assert set(found) == set(expected)
    costs = np.array([expected[chosen] for chosen in found])
    assert np.all(np.diff(costs) > -ROUNDING)


def test_hidden_torso_markers_and_too_few_points():
    candidates = TorsoCandidates(examples(0.01))
    assert choose(candidates, TORSO_M)[0].tolist() == [0, 1, 2, 3]
    assert choose(candidates, TORSO_M[[3, 1, 0]])[0].tolist() == [2, 1, -1, 0]
    for count in range(FEWEST_TORSO):
        assert choose(candidates, TORSO_M[:count]).shape == (0, 4)


def test_likeliest_choices_are_kept():
    """In a crowd of points there are more choices than can be looked at; the torso's own stays among them."""
    generator = np.random.default_rng(3)
    crowd = generator.uniform(-0.3, 0.7, (60, 3))
    found = choose(TorsoCandidates(examples()), np.concatenate((crowd, TORSO_M)))
    assert len(found) == MOST
    assert [60, 61, 62, 63] in found[:100].tolist()


def test_work_is_split_into_pieces_of_suitable_size():
    generator = np.random.default_rng(4)
    few, many = (
        list(TorsoCandidates(examples()).choose(generator.uniform(-0.3, 0.7, (count, 3)))) for count in (10, 150)
    )
    assert sum(many) > 100.0 * sum(few)  # pairs of points, and choices of pairs, triples and fours
    assert max(many) <= WORK
    assert np.sum(np.array(many) < 0.1 * WORK) < 20
