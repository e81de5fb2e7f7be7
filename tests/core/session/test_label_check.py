"""Right labels stay where the markers were followed without a doubt."""

from collections.abc import Generator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from perfanim.core.labelling.initial_labelling import InitialLabels
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.label_check import LabelCheck, Rival

POINTS_M = np.array([[0.0, 1.0, 0.0], [0.4, 1.0, 0.0], [0.0, 1.5, 0.0], [0.4, 1.5, 0.0]])
EXCHANGED = np.array([1, 0, 2, 3])


class OneRival:
    """Stands for the labeller of a database whose poses say that two markers are exchanged."""

    def __init__(self, gain: float, *found: np.ndarray) -> None:
        self._gain = gain
        self._found = found
        self.labels = EXCHANGED

    def search(self, points_m: np.ndarray) -> Generator[int, None, InitialLabels]:
        yield 1
        return InitialLabels(self.labels, 20.0 - self._gain, POINTS_M, tuple((other, 20.0) for other in self._found))

    def cost(self, *_: Any) -> float:
        return 20.0


def rival(gain: float, is_sure: np.ndarray) -> Rival | None:
    """Return the labels that the first check finds better than the present ones."""
    check: Any = LabelCheck(OneRival(gain), ("a", "b", "c", "d"), np.ones(4, dtype=bool))  # type: ignore[arg-type]
    frame = MarkerFrame(0, 1.0, points_m=POINTS_M, covariances_m2=np.zeros((4, 3, 3)))
    pose = SimpleNamespace(observed_m=POINTS_M, markers_m=POINTS_M, confidence=0.9, time_s=1.0)
    return check.step(frame, 1 / 60, pose, is_sure)  # type: ignore[no-any-return]


def test_likelier_labels_replace_those_of_markers_that_may_be_others() -> None:
    found = rival(9.0, np.zeros(4, dtype=bool))
    assert found is not None
    np.testing.assert_array_equal(found.labels, EXCHANGED)
    assert not found.contradicts


def test_a_motion_unlike_the_database_does_not_rename_markers_that_were_followed() -> None:
    assert rival(9.0, np.array([True, False, False, False])) is None
    assert rival(9.0, np.array([False, False, True, True])) is not None  # the two are not concerned


def test_much_likelier_labels_rename_even_these() -> None:
    found = rival(25.0, np.ones(4, dtype=bool))
    assert found is not None
    assert found.contradicts


@pytest.mark.parametrize(("found", "certain"), [((), False), ((np.arange(4),), True)])
def test_a_search_that_misses_the_present_labels_does_not_confirm_them(found: tuple[np.ndarray, ...], certain: bool):
    check: Any = LabelCheck(OneRival(-30.0, *found), ("a", "b", "c", "d"), np.ones(4, dtype=bool))  # type: ignore[arg-type]
    frame = MarkerFrame(0, 1.0, points_m=POINTS_M, covariances_m2=np.zeros((4, 3, 3)))
    pose = SimpleNamespace(observed_m=POINTS_M, markers_m=POINTS_M, confidence=0.9, time_s=1.0)
    assert check.step(frame, 1 / 60, pose, np.zeros(4, dtype=bool)) is None
    assert (check.confidence(frame, POINTS_M) == 1.0) == certain


@pytest.mark.parametrize("refuted", [False, True])
@pytest.mark.parametrize("other", [EXCHANGED, np.array([0, 1, 3, 2])])
def test_each_other_labelling_has_its_own_evidence(other: np.ndarray, refuted: bool):
    searches = OneRival(2.5)
    check: Any = LabelCheck(searches, ("a", "b", "c", "d"), np.ones(4, dtype=bool))  # type: ignore[arg-type]
    found = []
    for number, labels in enumerate((EXCHANGED, other, EXCHANGED)):
        searches.labels = labels
        time_s = 1.0 + 0.2 * number
        frame = MarkerFrame(number, time_s, points_m=POINTS_M, covariances_m2=np.zeros((4, 3, 3)))
        pose = SimpleNamespace(observed_m=POINTS_M, markers_m=POINTS_M, confidence=0.9, time_s=time_s)
        found.append(check.step(frame, 0.2, pose, np.zeros(4, dtype=bool)))
        if refuted and number == 1:
            check.refute((1, 0, 2, 3))
    assert found[:2] == [None, None]
    assert (found[2] is not None) == (other is EXCHANGED and not refuted)
