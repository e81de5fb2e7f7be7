"""Labels of points compared with others: which are proposed, and what uncertain ones are worth."""

from typing import Any

import numpy as np
import pytest
from perfanim.core.body.pose_notes import NoteKind
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.hypotheses import Tracked
from perfanim.core.session.point_labels import PointHypothesis, PointLabels, PointSettings
from perfanim.core.solver.observation import Observation

POINTS_M = np.array([[0.0, 1.0, 0.0], [0.4, 1.0, 0.0], [0.0, 1.5, 0.0], [0.4, 1.5, 0.0]])
EXCHANGED = [1, 0, 2, 3]


def hypothesis(observation: Observation, cost: float = 0.0) -> PointHypothesis:
    tracked = Tracked.of(observation, None)
    return PointHypothesis(None, tracked, NoteKind.LABELLED, cost, object(), None, None)  # type: ignore[arg-type]


def certain() -> Any:
    """Return labels that the last search has found certain; no body is needed to tell how certain they are."""
    labels = PointLabels.__new__(PointLabels)
    labels._misplaced_m = 0.0
    return labels


def frame_of(points_m: np.ndarray) -> MarkerFrame:
    return MarkerFrame(0, 0.0, points_m=points_m, covariances_m2=np.zeros((len(points_m), 3, 3)))


@pytest.mark.parametrize(("apart_m", "least", "most"), [(0.02, 0.9, 0.999), (0.4, 0.3, 0.32)])
def test_uncertain_labels_lower_the_confidence_by_how_far_others_move_the_markers(apart_m, least, most):
    """Labels that are as likely for two neighbours matter less than for the two hands."""
    points_m = POINTS_M * [apart_m / 0.4, 1.0, 1.0]
    best, other = (Observation.of_points(points_m[order]) for order in (np.arange(4), EXCHANGED))
    unsure = [hypothesis(best), hypothesis(other, PointSettings.sure)]
    assert least < certain().confidence(unsure, frame_of(points_m)) < most
    sure = [hypothesis(best), hypothesis(other, PointSettings.sure + 0.1)]
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
