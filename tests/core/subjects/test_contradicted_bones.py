"""A skeleton that is given with a take whose markers contradict its bones."""

import re

import numpy as np
import perfanim
import pytest
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.verdict import ReasonKind
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.subjects.body_change import PARTS, sized

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
