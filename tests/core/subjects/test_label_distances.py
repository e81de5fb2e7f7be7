"""Labels judged by the distances between markers."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.subjects.label_distances import contradiction

SUIT = load_marker_set("cmu-41")


@pytest.fixture(scope="module")
def walk(truth):
    """A walk of a performer whose markers are up to a few centimetres from their usual places."""
    away_m = np.random.default_rng(4).normal(0.0, 0.015, (len(SUIT), 3))
    return simulate_markers(truth, SUIT.with_offsets(SUIT.offsets_m + away_m), noise_mm=1.0, dropout=0.02)[0]


def exchanged(take, count):
    """Return the take with this many labels passed on to the next marker in a random order."""
    order = np.random.default_rng(2).permutation(len(take.names))[:count]
    names = list(take.names)
    for marker, other in zip(order, np.roll(order, 1), strict=True):
        names[marker] = take.names[other]
    return replace(take, names=tuple(names))


@pytest.mark.parametrize("unit", [1.0, 1e3, 0.6])
def test_true_labels_are_not_contradicted_whatever_the_unit_and_the_size(walk, database, unit):
    assert contradiction(replace(walk, positions_m=unit * walk.positions_m), SUIT, database) < 0.5


@pytest.mark.parametrize("count", [14, 41])
def test_exchanged_labels_are_contradicted(walk, database, count):
    assert contradiction(exchanged(walk, count), SUIT, database) > 1.0


def test_a_few_markers_and_keypoints_are_not_judged(walk, database):
    few = exchanged(walk, 41)
    few = replace(few, names=few.names[:7], positions_m=few.positions_m[:, :7])
    assert contradiction(few, SUIT, database) == 0.0
    keypoints = load_marker_set("halpe-26")
    points = replace(walk, names=keypoints.names, positions_m=walk.positions_m[:, : len(keypoints)])
    assert contradiction(points, keypoints, database) == 0.0
