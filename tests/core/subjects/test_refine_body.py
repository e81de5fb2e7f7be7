"""Bones and offsets corrected by motion."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.errors import SubjectError
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.subjects.body_change import PARTS, sized
from perfanim.core.subjects.refine_body import refine_body

WALK = "walking-02-energetic"


@pytest.fixture(scope="module")
def right(embedded_motion):
    return Subject("walker", embedded_motion[WALK].skeleton, load_marker_set("two-webcams"))


@pytest.fixture(scope="module")
def take(embedded_motion, right):
    return simulate_markers(embedded_motion[WALK], right.marker_set, noise_mm=2.0, seed=5)[0]


def bone_errors(subject, right):
    """Distances of joints from their parents, as shares of the right ones less one."""
    found, true = (np.linalg.norm(each.skeleton.offsets_m[1:], axis=1) for each in (subject, right))
    return np.abs(found[true > 0.0] / true[true > 0.0] - 1.0)


def test_wrong_bones_come_closer_to_the_right_ones(take, right, database):
    wrong = Subject("walker", sized(right.skeleton, np.full(len(PARTS), 0.1)), right.marker_set)
    result = refine_body(take, wrong, database)
    assert bone_errors(result.subject, right).mean() < 0.6 * bone_errors(wrong, right).mean()
    assert all(0.0 < sigma < 0.1 for sigma in result.size_sigmas.values())
    assert result.frames > 5


def test_a_right_body_stays_as_it_is(take, right, database):
    result = refine_body(take, right, database)
    assert bone_errors(result.subject, right).max() < 0.02
    moved = np.linalg.norm(result.subject.marker_set.offsets_m - right.marker_set.offsets_m, axis=1)
    assert moved.max() < 0.01
    assert set(result.offset_sigmas_m) == set(right.marker_set.names)


def test_motion_unlike_the_database_refines_nothing(embedded_motion, right, database):
    """Feet above the head, as no example has them."""
    motion = sliced(embedded_motion[WALK], 0, 60)
    take = simulate_markers(motion, right.marker_set, seed=5)[0]
    jumbled = take.positions_m[:, ::-1].copy()
    with pytest.raises(SubjectError, match="near motion of the database"):
        refine_body(replace(take, positions_m=jumbled), right, database)
