"""Faults of labels in takes made from shipped motion."""

from dataclasses import replace

import numpy as np
import pytest
from bench.label_faults import scored, with_faults
from perfanim.core.markers.label_faults import FaultKind, correct_labels, told
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import SingleViews
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.studio_rig import default_rig

from tests.helpers.exchanged_sides import sides_exchanged


@pytest.fixture(scope="module")
def take(truth, subject):
    return simulate_markers(truth, subject, noise_mm=0.5, seed=3)[0]


def exchanged(take, pairs, rows):
    """The take with labels exchanged in rows."""
    positions = take.positions_m.copy()
    for pair in pairs:
        columns = [take.names.index(name) for name in pair]
        positions[rows, columns] = positions[rows, columns[::-1]]
    return replace(take, positions_m=positions)


def test_clean_take_stays_as_it_is(take, subject):
    corrected, faults = correct_labels(take, subject)
    assert corrected is take and faults == ()


@pytest.mark.parametrize("noise_mm", [0.0, 3.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_faults_at_random_places_are_found_and_undone(truth, subject, noise_mm, seed):
    clean = simulate_markers(truth, subject, noise_mm, seed=seed)[0]
    faulty, faults = with_faults(clean, ("FOO", "HAN", "sides", "wild"), seed)
    corrected, found = correct_labels(faulty, subject)
    rows, alarms = scored(clean, corrected, corrected.positions_m, found, faults)
    assert faults and all(row["found"] and row["left_wrong"] == 0.0 for row in rows) and alarms == []


def test_frozen_hand_is_missing(take, subject):
    positions = take.positions_m.copy()
    hand, speeds = take.names.index("RHAN"), np.linalg.norm(np.diff(take.positions_m[:, 0], axis=0), axis=-1)
    first = int(np.argmax(np.convolve(speeds[3:-20], np.ones(12), "valid"))) + 3
    positions[first + 1 : first + 13, hand] = positions[first, hand]
    corrected, faults = correct_labels(replace(take, positions_m=positions), subject)
    assert [(fault.kind, fault.labels) for fault in faults] == [(FaultKind.FROZEN, ("RHAN",))]
    assert (faults[0].first, faults[0].last) == (first + 1, first + 12)
    assert np.isnan(corrected.positions_m[first + 1 : first + 13, hand]).all()


def test_marker_on_a_body_that_stands_is_not_frozen(take, subject):
    still = replace(take, positions_m=take.positions_m.copy())
    still.positions_m[10:30] = still.positions_m[10]
    assert not [fault for fault in correct_labels(still, subject)[1] if fault.kind is FaultKind.FROZEN]


def test_body_that_jumps_as_a_whole_has_no_wild_points(take, subject):
    cut = replace(take, positions_m=take.positions_m.copy())
    cut.positions_m[20:] += 0.5
    assert correct_labels(cut, subject)[1] == ()


def test_exchange_beside_gaps_and_rays_is_put_back(take, subject):
    rows = slice(15, 27)
    cameras, points = np.full(take.positions_m.shape[:2], -1), np.full((*take.positions_m.shape[:2], 2), np.nan)
    feet = [take.names.index(name) for name in ("LFOO", "RFOO")]
    positions = exchanged(take, [("LFOO", "RFOO")], rows).positions_m
    positions[20:22, feet[0]] = np.nan
    cameras[20:22, feet[0]], points[20:22, feet[0]] = 1, 0.25
    faulty = replace(take, positions_m=positions, single=SingleViews(default_rig(), cameras, points))
    corrected, faults = correct_labels(faulty, subject)
    assert [(fault.kind, fault.labels, fault.first, fault.last) for fault in faults] == [
        (FaultKind.EXCHANGED, ("LFOO", "RFOO"), 15, 26)
    ]
    seen = corrected.visible
    np.testing.assert_array_equal(corrected.positions_m[seen], take.positions_m[seen])
    assert corrected.single.cameras[20:22, feet[1]].tolist() == [1, 1]
    assert (corrected.single.points[20:22, feet[1]] == 0.25).all() and (
        corrected.single.cameras[:, feet[0]] == -1
    ).all()


def test_stretch_names_frames_of_the_file(take, subject):
    numbered = replace(exchanged(take, [("LFOO", "RFOO")], slice(15, 27)), frame_numbers=np.arange(take.frames) + 101)
    _, (fault,) = correct_labels(numbered, subject)
    stretch = fault.stretch(numbered)
    assert stretch.reason == "LFOO and RFOO had each other's labels, corrected (frames 116 to 127)"
    assert (stretch.first, stretch.last) == (15, 26) and stretch.start_s == pytest.approx(15 / take.fps)


def test_takes_too_short_or_empty_stay(take, subject):
    short = replace(take, positions_m=take.positions_m[:5], frame_numbers=np.empty(0), times_s=np.empty(0))
    assert correct_labels(short, subject) == (short, ())
    empty = replace(take, positions_m=np.full_like(take.positions_m, np.nan))
    assert correct_labels(empty, subject) == (empty, ())


@pytest.fixture(scope="module")
def suit(truth, subject):
    """A performer in a suit with markers on front and back, and a take."""
    worn = replace(subject, marker_set=load_marker_set("cmu-41"))
    return worn, simulate_markers(truth, worn, noise_mm=1.0, seed=6)[0]


def test_sides_exchanged_in_a_whole_take_are_put_back_and_told(suit):
    worn, take = suit
    corrected, faults = correct_labels(sides_exchanged(take), worn)
    np.testing.assert_array_equal(corrected.positions_m, take.positions_m)
    assert [(fault.kind, fault.first, fault.last) for fault in faults] == [(FaultKind.SIDES, 0, take.frames - 1)]
    assert {"LKNE", "RKNE", "LFHD", "RBWT"} <= set(faults[0].labels) and "C7" not in faults[0].labels
    reason = "left and right had each other's labels, corrected; or the take is"
    assert faults[0].stretch(take).reason.startswith(reason)


def test_mirrored_take_gets_the_labels_of_a_body(suit):
    worn, take = suit
    mirrored = replace(take, positions_m=take.positions_m * [-1.0, 1.0, 1.0])
    corrected, faults = correct_labels(mirrored, worn)
    assert [fault.kind for fault in faults] == [FaultKind.SIDES]
    np.testing.assert_array_equal(corrected.positions_m, sides_exchanged(mirrored).positions_m)


def test_exchange_of_a_stretch_in_a_take_with_exchanged_sides_is_put_back(suit):
    worn, take = suit
    faulty = exchanged(sides_exchanged(take), [("LKNE", "RKNE"), ("LANK", "RANK")], slice(15, 27))
    corrected, faults = correct_labels(faulty, worn)
    np.testing.assert_array_equal(corrected.positions_m, take.positions_m)
    assert {fault.kind for fault in faults} == {FaultKind.EXCHANGED, FaultKind.SIDES}


def test_performer_who_walks_backwards_has_the_right_labels(suit, take, subject):
    for worn, forwards in (suit, (subject, take)):
        backwards = replace(forwards, positions_m=forwards.positions_m[::-1])
        assert correct_labels(backwards, worn)[1] == ()


def test_sides_stay_where_the_markers_show_no_front(take, subject):
    assert not [fault for fault in correct_labels(sides_exchanged(take), subject)[1] if fault.kind is FaultKind.SIDES]


def test_warnings_name_the_first_stretches(take, subject):
    stretches = [
        fault.stretch(take) for fault in correct_labels(exchanged(take, [("LFOO", "RFOO")], slice(15, 27)), subject)[1]
    ]
    assert told(stretches) == [stretches[0].reason]
    assert told(stretches * 12)[8:] == ["and 4 more stretches with wrong labels"]
