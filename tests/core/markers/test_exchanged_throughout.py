"""Two markers of a limb that have each other's labels in the whole take."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.markers.label_faults import FaultKind, correct_labels
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.simulated_markers import simulate_markers

SUIT = load_marker_set("plug-in-gait")


@pytest.fixture(scope="module")
def walker(truth):
    return Subject("walker", truth.skeleton, SUIT)


@pytest.fixture(scope="module")
def take(truth):
    """A walk in a suit worn otherwise than usual, with other places of the thighs' and arms' markers on the left."""
    moved = SUIT.offsets_m + np.random.default_rng(3).normal(0.0, 0.01, (len(SUIT), 3))
    along = truth.skeleton.tips_m[SUIT.joint_indices(truth.skeleton)]
    for name in ("LTHI", "LUPA", "LFRM", "LTIB"):
        moved[SUIT.names.index(name)] += 0.25 * along[SUIT.names.index(name)]
    return simulate_markers(sliced(truth, 0, 60), SUIT.with_offsets(moved), noise_mm=1.0, seed=2)[0]


def test_a_suit_worn_otherwise_than_usual_has_no_exchanged_labels(take, walker):
    assert correct_labels(take, walker)[1] == ()


@pytest.mark.parametrize("pair", [("LKNE", "LTIB"), ("RANK", "RHEE"), ("RELB", "RWRA")])
def test_labels_exchanged_throughout_are_put_back(take, walker, pair):
    columns = [take.names.index(name) for name in pair]
    positions_m = take.positions_m.copy()
    positions_m[:, columns] = positions_m[:, columns[::-1]]
    found, faults = correct_labels(replace(take, positions_m=positions_m), walker)
    (fault,) = faults
    assert (fault.kind, fault.first, fault.last) == (FaultKind.EXCHANGED, 0, take.frames - 1)
    assert set(fault.labels) == set(pair)
    np.testing.assert_array_equal(found.positions_m, take.positions_m)


def test_labels_of_a_limb_without_another_side_stay(take, walker):
    right = [i for i, name in enumerate(take.names) if not name.startswith("L")]
    columns = [take.names.index(name) for name in ("RANK", "RTOE")]
    positions_m = take.positions_m.copy()
    positions_m[:, columns] = positions_m[:, columns[::-1]]
    alone = replace(take, names=tuple(take.names[i] for i in right), positions_m=positions_m[:, right])
    assert correct_labels(alone, walker)[1] == ()
