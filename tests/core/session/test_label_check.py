"""Right labels stay where the markers were followed without a doubt."""

from collections.abc import Generator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from perfanim.core.labelling.initial_labelling import InitialLabels
from perfanim.core.labelling.label_search import WORK_UNHURRIED
from perfanim.core.labelling.labeller import Labeller
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.frame_labelling import FrameLabeller
from perfanim.core.session.label_check import Alternative, LabelCheck

POINTS_M = np.array([[0.0, 1.0, 0.0], [0.4, 1.0, 0.0], [0.0, 1.5, 0.0], [0.4, 1.5, 0.0]])
EXCHANGED = np.array([1, 0, 2, 3])
SEEN = np.ones(4, dtype=bool)


def pose_with(observed_m: np.ndarray, agreement: float, time_s: float) -> Any:
    """Return a pose with these markers, none of which a single camera saw."""
    seen = np.isfinite(observed_m[:, 0])
    return SimpleNamespace(observed_m=observed_m, markers_m=POINTS_M, agreement=agreement, time_s=time_s, seen=seen)


class Search:
    """Stands for a labeller of a database: finds labellings (labels, gain over the present ones), the best first."""

    def __init__(self, *rows: tuple[np.ndarray, float]) -> None:
        self._rows = rows

    def search(self, points_m: np.ndarray) -> Generator[int, None, InitialLabels]:
        yield 1
        (labels, gain), *alternatives = self._rows
        costs = tuple((other, 20.0 - less) for other, less in alternatives)
        return InitialLabels(labels, 20.0 - gain, POINTS_M, costs)

    def cost(self, *_: Any) -> float:
        return 20.0


def exchange(gain: float, *found: np.ndarray) -> Search:
    """Return a search that says that two markers are exchanged, and also finds labels as likely as the present ones."""
    return Search((EXCHANGED, gain), *((other, 0.0) for other in found))


def check_of(search: Search) -> Any:
    return LabelCheck(search, SEEN)  # type: ignore[arg-type]


def frame_at(number: int = 0, time_s: float = 1.0, points_m: np.ndarray = POINTS_M) -> MarkerFrame:
    return MarkerFrame(number, time_s, points_m=points_m, covariances_m2=np.zeros((4, 3, 3)))


def stepped(check: Any, times_s: Sequence[float], is_confident: np.ndarray, observed_m: np.ndarray = POINTS_M) -> list:
    """Return the labels that checks of one pose at these times find."""
    poses = [(number, time_s, pose_with(observed_m, 0.9, time_s)) for number, time_s in enumerate(times_s)]
    return [
        check.step(frame_at(number, time_s), 0.1, pose, pose.agreement, is_confident) for number, time_s, pose in poses
    ]


def judged(search: Search, observed_m: np.ndarray = POINTS_M, is_confident: np.ndarray = ~SEEN) -> tuple[Any, Any]:
    """Return a check and the labels that it finds for a pose with these markers."""
    check = check_of(search)
    return check, check.step(frame_at(), 1 / 60, pose_with(observed_m, 0.9, 1.0), 0.9, is_confident)


def alternative(gain: float, is_confident: np.ndarray) -> Alternative | None:
    """Return the labels that the first check finds better than the present ones."""
    return judged(exchange(gain), is_confident=is_confident)[1]


def test_likelier_labels_replace_uncertain_ones() -> None:
    found = alternative(9.0, ~SEEN)
    assert found is not None
    np.testing.assert_array_equal(found.labels, EXCHANGED)
    assert not found.contradicts


def test_confidently_tracked_markers_keep_labels_in_unfamiliar_motion() -> None:
    assert alternative(9.0, np.array([True, False, False, False])) is None
    assert alternative(9.0, np.array([False, False, True, True])) is not None  # the two are not concerned


def test_much_likelier_labels_replace_confidently_tracked_ones() -> None:
    found = alternative(25.0, SEEN)
    assert found is not None
    assert found.contradicts


@pytest.mark.parametrize(("found", "certain"), [((), False), ((np.arange(4),), True)])
def test_search_that_misses_the_current_labels_does_not_confirm_them(found: tuple[np.ndarray, ...], certain: bool):
    check, other = judged(exchange(-30.0, *found))
    assert other is None
    assert (check.confidence(frame_at(), SEEN) == 1.0) == certain


@pytest.mark.parametrize(("apart_m", "least", "most"), [(0.02, 0.9, 0.999), (0.4, 0.3, 0.32)])
def test_uncertain_labels_lower_the_confidence_by_how_far_others_move_the_markers(apart_m, least, most):
    """Labels that are as likely for two neighbours matter less than for the two hands."""
    points_m = POINTS_M * [apart_m / 0.4, 1.0, 1.0]
    check, frame = check_of(exchange(-0.5, np.arange(4))), frame_at(points_m=points_m)
    check.step(frame, 1 / 60, pose_with(points_m, 0.9, 1.0), 0.9, ~SEEN)
    assert not check.is_certain(frame, SEEN)
    assert least < check.confidence(frame, SEEN) < most


def test_points_of_markers_that_one_camera_sees_are_no_strays() -> None:
    """Pictures that are not of one moment place no marker, but show all."""
    check, frame = judged(Search((np.arange(4), 0.0), (EXCHANGED, -30.0)))[0], frame_at()
    assert check.confidence(frame, SEEN) == 1.0
    assert check.confidence(frame, np.array([True, True, False, False])) < 1.0


@pytest.mark.parametrize("refuted", [False, True])
@pytest.mark.parametrize("other", [EXCHANGED, np.array([0, 1, 3, 2])])
def test_each_alternative_has_its_own_evidence(other: np.ndarray, refuted: bool):
    check, found = check_of(exchange(2.5)), []
    for number, labels in enumerate((EXCHANGED, other, EXCHANGED)):
        check._initial, time_s = Search((labels, 2.5)), 1.0 + 0.2 * number
        found.append(check.step(frame_at(number, time_s), 0.2, pose_with(POINTS_M, 0.9, time_s), 0.9, ~SEEN))
        if refuted and number == 1:
            check.refute((1, 0, 2, 3))
    # before they are proven an example must be clearly nearer to them
    proven = [alternative is not None and alternative.nearer == 1.0 for alternative in found]
    assert proven == [False, False, other is EXCHANGED and not refuted]


def checks(check: Any, numbers: range) -> list[bool]:
    """Return whether other labels are to be tried, for checks a second apart."""
    frames = [frame_at(number, 1.0 + number) for number in numbers]
    return [check.step(frame, 1.0, pose_with(POINTS_M, 0.9, frame.time_s), 0.9, ~SEEN) is not None for frame in frames]


@pytest.mark.parametrize(("gain", "times"), [(-0.5, 7), (-3.0, 1), (-6.0, 0)])
def test_plausible_labels_are_tried_once_and_while_the_current_ones_are_uncertain(gain: float, times: int):
    """Crossed feet look much like feet that are not: only a nearer example can tell."""
    check, found = judged(Search((np.arange(4), 0.0), (EXCHANGED, gain)))
    tried = [found is not None, *checks(check, range(1, 12))]
    assert tried == [True] * times + [False] * (12 - times)  # the evidence against them grows
    if found is not None:
        assert found.nearer < 1.0
        np.testing.assert_array_equal(found.labels, EXCHANGED)


def test_postponed_labels_are_tried_again() -> None:
    check, found = judged(Search((np.arange(4), 0.0), (EXCHANGED, -1.8)))
    assert found is not None
    check.put_off(found.renaming)
    assert checks(check, range(1, 3)) == [True, False]


def test_newly_labelled_point_is_not_evidence_for_relabelling_others() -> None:
    observed_m = POINTS_M.copy()
    observed_m[3] = np.nan
    _, found = judged(Search((EXCHANGED, 6.2), (np.arange(4), 5.2)), observed_m)
    assert found is not None
    np.testing.assert_array_equal(found.labels, np.arange(4))
    _, found = judged(Search((EXCHANGED, 12.0), (np.arange(4), 5.2)), observed_m)
    assert found is not None
    np.testing.assert_array_equal(found.labels, EXCHANGED)


def test_check_confirms_only_located_markers() -> None:
    observed_m = POINTS_M.copy()
    observed_m[2] = np.nan
    check, _ = judged(Search((np.array([0, 1, -1, 3]), 0.0)), observed_m)
    np.testing.assert_array_equal(check.confirmed_markers, [True, True, False, True])


def test_certain_labels_become_uncertain_when_the_body_was_gone() -> None:
    check, frame = judged(Search((np.arange(4), 0.0), (EXCHANGED, -30.0)))[0], frame_at()
    stepped(check, [1.02], ~SEEN)
    assert check.confidence(frame, SEEN) == 1.0
    check._search = None
    check._initial = exchange(2.0)  # it misses the present labels: no confirmation
    stepped(check, [1.6], ~SEEN)
    assert check.confidence(frame, SEEN) < 1.0


def test_marker_hidden_since_the_check_is_not_confirmed() -> None:
    check, _ = judged(Search((np.arange(4), 0.0), (EXCHANGED, -30.0)))
    hidden = POINTS_M.copy()
    hidden[1] = np.nan
    stepped(check, [1.01], ~SEEN, hidden)
    stepped(check, [1.02], ~SEEN)
    np.testing.assert_array_equal(check.confirmed_markers, [True, False, True, True])


@pytest.mark.parametrize(("apart_s", "needed"), [(0.1, 4), (0.3, 3), (1.0, 3)])
def test_relabelling_penalty_counts_once(apart_s: float, needed: int) -> None:
    """Wrong labels that a weak check made certain are given up in the end; a pose that rests proves less."""
    check = check_of(exchange(7.5, np.arange(4)))
    times_s = [1.0 + 1.01 * apart_s * number for number in range(9)]
    # before they are proven an example must be clearly nearer to them
    proven = [each is not None and each.nearer == 1.0 for each in stepped(check, times_s, SEEN)]
    assert proven.index(True) + 1 == needed


@pytest.mark.parametrize(("agreement", "sure"), [(0.9, True), (0.3, False)])
def test_suspect_first_pose_confirms_no_labels(agreement: float, sure: bool) -> None:
    order, frame = np.arange(4), frame_at()
    labeller: Any = FrameLabeller.__new__(FrameLabeller)  # a database is not needed here
    labeller._labeller = Labeller(SEEN)
    labeller._labeller.begin(POINTS_M, order, ~SEEN)
    labeller._check = check_of(exchange(-30.0))
    labeller._check.begin(1.0, InitialLabels(order, 20.0, POINTS_M, ((EXCHANGED, 50.0),)))
    assert labeller.confidence(frame, SEEN) == 1.0  # the search was certain
    pose = pose_with(POINTS_M, agreement, 1.0)
    assert labeller.find_alternative(frame, 1 / 60, pose, agreement) is None
    assert labeller._labeller.is_confident.all() == labeller._labeller.is_confident.any() == sure


@pytest.mark.parametrize(("gain", "hidden", "frames"), [(-30.0, 0, 4), (9.0, 0, 1), (-30.0, 1, 1)])
def test_check_is_unhurried_while_labels_are_unsuspicious(gain: float, hidden: int, frames: int) -> None:
    """Of four frames each takes a share of the work; of labels in doubt, or with a point left over, one takes all."""

    begun = []

    class Slow(Search):
        def search(self, points_m: np.ndarray) -> Generator[int, None, InitialLabels]:
            begun.append(points_m)
            for _ in range(7):
                yield WORK_UNHURRIED // 2
            return (yield from super().search(points_m))

    check = check_of(exchange(gain, np.arange(4)))
    stepped(check, [1.0], ~SEEN)
    check._initial, observed_m = Slow((EXCHANGED, gain), (np.arange(4), 0.0)), POINTS_M.copy()
    observed_m[:hidden] = np.nan
    searching = 0
    for time_s in np.arange(1.01, 2.0, 0.01).tolist():
        stepped(check, [time_s], ~SEEN, observed_m)
        searching += len(begun)
        if begun and check._search is None:
            break
    assert searching == frames
