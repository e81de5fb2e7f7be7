"""Takes whose markers contradict the skeleton that is given, or the places of their set."""

import re
from dataclasses import replace

import numpy as np
import perfanim
import pytest
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.verdict import ReasonKind
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.subjects.body_change import PARTS, sized
from perfanim.core.subjects.contradictions import contradicted_places, moved_markers

SUIT = load_marker_set("plug-in-gait")


@pytest.fixture(scope="module")
def told(truth, database):
    """told(arms) -> the verdict's texts for arms that are so much longer in the take, in a suit worn a little off."""
    off_m = np.random.default_rng(5).uniform(-0.015, 0.015, (len(SUIT), 3))

    def solved(arms):
        body = sized(truth.skeleton, np.array([arms if part == "arms" else 0.0 for part in PARTS]))
        pose = np.tile(t_pose(body), (20, 1, 1))
        held = Motion("held", 30.0, body, pose, np.tile(truth.root_positions_m[0], (20, 1)))
        take = simulate_markers(held, SUIT.with_offsets(SUIT.offsets_m + off_m), noise_mm=1.0, seed=2)[0]
        wearer = Subject("wearer", truth.skeleton, SUIT)
        reasons = perfanim.solve(take, wearer, database).verdict.reasons
        return [reason.text for reason in reasons if reason.kind is ReasonKind.LIMB]

    return solved


def test_arms_that_are_too_short_are_named(told):
    found = re.fullmatch(
        "the skeleton contradicts the markers: arms at least ([0-9]+) % longer in the take", told(0.2)[0]
    )
    assert 10 < int(found[1]) < 25


def test_the_right_bones_are_not_contradicted_by_a_suit_worn_a_little_off(told):
    assert told(0.0) == []


def worn_at(offsets_m, skeleton):
    """Return a wearer with markers moved by name to offsets."""
    markers = [replace(each, offset_m=offsets_m.get(each.name, each.offset_m)) for each in SUIT.markers]
    return Subject("wearer", skeleton, replace(SUIT, markers=tuple(markers)))


def test_markers_far_from_their_usual_places_are_listed_but_not_those_that_slid_along_a_bone(truth):
    usual = {marker.name: np.array(marker.offset_m) for marker in SUIT.markers}
    thigh = truth.skeleton.tips_m[truth.skeleton.index("lfemur")]
    off = {
        "LELB": usual["LELB"] + [0.0, 0.0, 0.2],
        "LTHI": usual["LTHI"] + 0.2 * thigh,
        "C7": usual["C7"] + [0.07, 0, 0],
    }
    found = moved_markers(worn_at(off, truth.skeleton), SUIT)
    assert {name: round(m, 3) for name, m in found.items()} == {"LELB": 0.2, "C7": 0.07}
    assert contradicted_places(found) == "LELB is 200 mm away from the usual position on the body: check the label"
    assert contradicted_places(moved_markers(worn_at({}, truth.skeleton), SUIT)) == ""


@pytest.mark.long
def test_a_label_of_a_marker_that_is_elsewhere_is_a_reason(truth, database):
    elsewhere = next(marker for marker in SUIT.markers if marker.name == "STRN")
    markers = [replace(elsewhere, name=each.name) if each.name == "LFHD" else each for each in SUIT.markers]
    take = simulate_markers(sliced(truth, 0, 30), replace(SUIT, markers=tuple(markers)), noise_mm=1.0, seed=2)[0]
    solved = perfanim.solve(take, None, database)
    assert next(iter(solved.report["moved_mm"])) == "LFHD"
    assert any(reason.text.startswith("LFHD is ") for reason in solved.verdict.reasons)
