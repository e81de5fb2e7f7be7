"""Labels of points compared with others: which are proposed, and what uncertain ones are worth."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.pose_notes import NoteKind
from perfanim.core.labelling.label_search import WORK_ALONE
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.hypotheses import Tracked
from perfanim.core.session.label_alternatives import AlternativeSettings, LabelAlternatives, PointHypothesis
from perfanim.core.session.point_labels import PointLabels, PointSettings
from perfanim.core.session.session import Session
from perfanim.core.solver.observation import Observation

POINTS_M = np.array([[0.0, 1.0, 0.0], [0.4, 1.0, 0.0], [0.0, 1.5, 0.0], [0.4, 1.5, 0.0]])
EXCHANGED = [1, 0, 2, 3]


def hypothesis(observation: Observation, cost: float = 0.0) -> PointHypothesis:
    tracked = Tracked.of(observation, None)
    return PointHypothesis(None, tracked, NoteKind.LABELLED, cost, object(), None, None)  # type: ignore[arg-type]


def alternatives() -> LabelAlternatives:
    """Return alternatives of which the last search has found none; no body is needed to tell how certain labels are."""
    solver: Any = SimpleNamespace(subject=SimpleNamespace(torso=np.ones(4, dtype=bool)))
    found = LabelAlternatives(solver, None, 0.0)  # type: ignore[arg-type]
    found._misplaced_m = 0.0
    return found


def certain() -> Any:
    labels = PointLabels.__new__(PointLabels)
    labels._alternatives = alternatives()
    return labels


class Confirmed:
    """Stands for a labeller that has tracked the best labels; notes which markers are confirmed."""

    markers: list[bool] | None = None

    def confirm(self, markers: np.ndarray) -> None:
        self.markers = markers.tolist()


def frame_of(points_m: np.ndarray) -> MarkerFrame:
    return MarkerFrame(0, 0.0, points_m=points_m, covariances_m2=np.zeros((len(points_m), 3, 3)))


@pytest.mark.parametrize(
    ("apart_m", "cost", "least", "most"),
    [(0.02, 0.0, 0.9, 0.999), (0.4, 0.0, 0.3, 0.32), (0.4, 1.0, 0.4, 0.7), (0.4, AlternativeSettings.sure, 0.8, 0.9)],
)
def test_uncertain_labels_lower_the_confidence_by_how_far_and_how_likely_others_move_the_markers(
    apart_m, cost, least, most
):
    """Labels that are as likely for two neighbours matter less than for the two hands, and less likely ones, too."""
    points_m = POINTS_M * [apart_m / 0.4, 1.0, 1.0]
    best, other = (Observation.of_points(points_m[order]) for order in (np.arange(4), EXCHANGED))
    unsure = [hypothesis(best), hypothesis(other, AlternativeSettings.start + cost)]
    assert least < certain().confidence(unsure, frame_of(points_m)) < most
    sure = [hypothesis(best), hypothesis(other, AlternativeSettings.start + AlternativeSettings.sure + 0.1)]
    assert certain().confidence(sure, frame_of(points_m)) == 1.0


def test_points_of_markers_that_one_camera_sees_are_no_strays() -> None:
    """Pictures that are not of one moment place no marker, but show all."""
    points_m, cameras = POINTS_M.copy(), np.full(4, -1)
    points_m[:2] = np.nan
    values = []
    for seen in (-1, 0):
        cameras[:2] = seen
        rays = Observation(points_m, cameras.copy(), np.zeros((4, 2)))
        values.append(certain().confidence([hypothesis(rays)], frame_of(POINTS_M)))
    assert values == [PointSettings.uncertain, 1.0]


@pytest.mark.parametrize(("above", "refuted"), [(-0.1, False), (0.1, True)])
def test_labels_that_the_motion_refutes_are_not_proposed_again(above: float, refuted: bool) -> None:
    """Each search finds the same neighbours exchanged; where the motion has refuted that, tracking is confident."""
    best, other = (hypothesis(Observation.of_points(POINTS_M[order])) for order in (np.arange(4), EXCHANGED))
    best.labeller, other.cost = Confirmed(), PointLabels.hopeless + above
    found = alternatives()
    found._followed = [other]
    found._confirm_refuted([best] if refuted else [best, other])
    assert best.labeller.markers == ([True, True, False, False] if refuted else None)
    assert found._followed == ([] if refuted else [other])


@pytest.mark.parametrize(("nearest_m", "renewed"), [(1.0, True), (None, False)])
def test_a_body_that_has_lost_its_way_starts_over_with_the_same_labels(
    subject, database, record, true_markers, nearest_m, renewed
) -> None:
    """Its markers are far from the examples that it follows, but not from all."""
    session = Session(subject, database)
    for number in range(20):
        session.step(record(true_markers[number], number))
    found, frame = session.point_labels._alternatives, record(true_markers[20], 20)
    session.step(frame)
    best = session._given.best
    if nearest_m is not None:
        best.tracked = replace(best.tracked, solution=replace(best.tracked.solution, nearest_m=nearest_m))
    found._begin_search(best, frame)
    while not found._searched.search.advance(WORK_ALONE):
        pass
    found._waiting = found._alternatives(found._searched)
    born = found._begin_next(found._searched, best, frame)
    again = [each for each in born if each.begun is NoteKind.NEARER_EXAMPLE]
    assert bool(again) == renewed
    for each in again:
        assert each.cost < 0.0
        np.testing.assert_array_equal(each.tracked.observation.points_m, best.tracked.observation.points_m)
