"""Changes of a refined performer in words."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.subjects.body_change import PARTS
from perfanim.core.subjects.refine_body import Refinement
from perfanim.core.subjects.refinement_text import describe_changes, worthwhile


@pytest.fixture
def before():
    return Subject("Anna", default_skeleton(1.7), load_marker_set("one-camera"))


def refined(before, sizes, moved_mm, whole=0.0, evidence=50.0):
    """A refinement with these changes; of sigmas 1 % (whole), 0.5 % (parts), 1.2 mm (markers)."""
    offsets = before.marker_set.offsets_m.copy()
    for index, mm in moved_mm.items():
        offsets[index] += np.array([0.0, 1e-3 * mm, 0.0])
    subject = replace(before, marker_set=before.marker_set.with_offsets(offsets))
    all_sizes, names = dict.fromkeys(PARTS, 0.0) | sizes, before.marker_set.names
    sigmas = dict.fromkeys(PARTS, 0.005), dict.fromkeys(names, 0.0012)
    return Refinement(subject, whole, 0.01, all_sizes, *sigmas, 80, evidence)


def test_changes_are_named_the_largest_first_with_how_sure_they_are(before):
    found = refined(before, {"arms": 0.042, "hips": -0.06, "shanks": 0.011}, {1: 8.0, 0: 12.0}, -0.03)
    first, second = (before.marker_set.markers[index] for index in (0, 1))
    assert describe_changes(before, found) == [
        "whole body 3 % smaller (± 2 %)",
        "hips 6 % narrower (± 1 %)",
        "arms 4 % longer (± 1 %)",
        "lower legs 1 % longer (± 1 %)",
        f"marker {first.text or first.name} 12 mm (± 3 mm)",
        f"marker {second.text or second.name} 8 mm (± 3 mm)",
    ]


def test_changes_that_the_take_leaves_open_are_none(before):
    assert describe_changes(before, refined(before, {}, {})) == []
    assert describe_changes(before, refined(before, {"arms": 0.009, "feet": -0.01}, {0: 4.4}, 0.019)) == []
    for sizes, moved, whole in (({"arms": -0.011}, {}, 0.0), ({}, {0: 4.6}, 0.0), ({}, {}, 0.021)):
        found = refined(before, sizes, moved, whole)
        assert len(describe_changes(before, found)) == 1
        assert worthwhile(before, found)[0] is found.subject


def test_a_take_that_is_as_likely_with_the_old_body_changes_nothing(before):
    assert worthwhile(before, refined(before, {"arms": 0.1}, {0: 20.0}, 0.05, evidence=20.0)) == (before, [])


def test_many_markers_are_counted(before):
    count = len(before.marker_set)
    texts = describe_changes(before, refined(before, {}, {index: 20.0 - index for index in range(count)}))
    assert len(texts) == 5
    assert texts[-1] == f"{count - 4} more markers by up to 16 mm"
    same = refined(before, {}, dict.fromkeys(range(5), 9.0))
    assert describe_changes(before, same)[-1] == "1 more marker by up to 9 mm"


def test_every_part_has_its_words(before):
    texts = describe_changes(before, refined(before, dict.fromkeys(PARTS, -0.05), {}))
    assert len(texts) == len(PARTS)
    assert all("narrower" in text or "shorter" in text for text in texts)
