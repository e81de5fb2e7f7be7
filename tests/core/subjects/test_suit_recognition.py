"""Suits recognised by the motion of trajectories whose labels say nothing."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.api.take_reading import labelled_by
from perfanim.core.body.motion import sliced
from perfanim.core.errors import TakeError
from perfanim.core.labelling.up_axis import TURNS
from perfanim.core.markers.label_matching import AUTO
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.subjects import suit_recognition

SUIT = load_marker_set("helen-hayes")


@pytest.fixture
def few_suits(monkeypatch):
    """The right suit and a larger one to choose from, of all that have so many markers."""
    monkeypatch.setattr(suit_recognition, "marker_set_names", lambda: (SUIT.name, "plug-in-gait"))


@pytest.fixture(scope="module")
def unknown(truth):
    """A walk with z up under random labels, with a marker that lies on the floor, and the true name of each label."""
    generator = np.random.default_rng(5)
    worn = SUIT.with_offsets(SUIT.offsets_m + generator.normal(0.0, 0.01, (len(SUIT), 3)))
    take = simulate_markers(sliced(truth, 0, 120), worn, noise_mm=1.0, dropout=0.02, seed=3)[0]
    order = generator.permutation(len(SUIT))
    true = {f"M{number}": SUIT.names[marker] for number, marker in enumerate(order)}
    still = np.tile(generator.normal(0.0, 1.0, 3) * (1.0, 0.0, 1.0), (take.frames, 1, 1))
    positions = np.concatenate((take.positions_m[:, order], still), axis=1) @ TURNS["z"]
    return replace(take, names=(*true, "floor"), positions_m=positions), true


@pytest.mark.long
def test_unknown_labels_become_those_of_the_suit_that_moves_like_them(unknown, database):
    take, true = unknown
    named, worn = labelled_by(AUTO, take, database)
    assert worn.name == SUIT.name
    wrong = [(true.get(old), new) for old, new in zip(take.names, named.names, strict=True) if new != true.get(old)]
    assert wrong == [(None, "floor")]
    assert any("31 of 32 markers were recognised" in note for note in named.notes)


@pytest.mark.long
def test_labels_of_a_suit_that_are_exchanged_among_themselves_are_told_and_found_by_the_motion(
    few_suits, unknown, database
):
    take, true = unknown
    names = np.random.default_rng(3).permutation(list(true.values()))
    named, worn = labelled_by(AUTO, replace(take, names=(*names, "floor")), database)
    assert worn.name == SUIT.name
    assert named.names == (*true.values(), "floor")
    assert not named.is_guessed
    assert any("fit no body" in note for note in named.notes)


@pytest.mark.long
def test_trajectories_that_are_no_body_are_refused(few_suits, unknown, database):
    take = unknown[0]
    steps = np.random.default_rng(1).normal(0.0, 0.02, take.positions_m.shape)
    starts = np.random.default_rng(2).normal(0.0, 0.5, take.positions_m.shape[1:])
    with pytest.raises(TakeError, match="their motion fits no known marker set"):
        labelled_by(AUTO, replace(take, positions_m=starts + np.cumsum(steps, axis=0)), database)


def test_a_few_trajectories_and_a_missing_database_are_refused(unknown, database):
    take = unknown[0]
    few = replace(take, names=take.names[:5], positions_m=take.positions_m[:, :5])
    with pytest.raises(TakeError, match=r"there are too few trajectories \(5\) to show a body"):
        labelled_by(AUTO, few, database)
    with pytest.raises(TakeError, match="do not match any shipped marker set"):
        labelled_by(AUTO, take, None)
