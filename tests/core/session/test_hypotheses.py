"""Which hypothesis about labels is believed, and which are dropped."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.pose_notes import NoteKind
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.hypotheses import SETTINGS, Hypotheses, Hypothesis, Tracked
from perfanim.core.solver.observation import Observation

POINTS_M = np.array([[0.0, 1.0, 0.0], [0.4, 1.0, 0.0], [0.0, 1.5, 0.0]])


def hypothesis(points_m: np.ndarray = POINTS_M, cost: float = 0.0, apart_m: float = 0.0) -> Hypothesis:
    """Return a hypothesis with located markers, and a body that is so far from them."""
    solution: Any = SimpleNamespace(markers_m=POINTS_M + apart_m)
    tracked = Tracked.of(Observation.of_points(points_m), solution)
    return Hypothesis(None, tracked, NoteKind.LABELLED, cost, object())  # type: ignore[arg-type]


class Finder:
    """Stands for a label finder: adds known costs to the hypotheses, and proposes known ones."""

    hopeless = 25.0

    def __init__(self, first: Hypothesis, *proposed: Hypothesis) -> None:
        self.first, self.proposed, self.costs = first, list(proposed), {}

    def reset(self) -> None:
        pass

    def begin(self, frame: MarkerFrame, elapsed_s: float) -> Hypothesis:
        return self.first

    def continued(self, hypotheses, frame, elapsed_s, checks):
        for each in hypotheses:
            each.cost += self.costs.get(each.lineage, 0.0)
        return hypotheses

    def others(self, hypotheses, frame, elapsed_s):
        proposed, self.proposed = self.proposed, []
        return proposed


def followed(*proposed: Hypothesis) -> tuple[Hypotheses, Finder]:
    """Return the hypotheses after two frames, the second of which adds those proposed."""
    finder = Finder(hypothesis(), *proposed)
    hypotheses = Hypotheses(finder)  # type: ignore[arg-type]
    for number in range(2):
        hypotheses.step(MarkerFrame(number, float(number)))
    return hypotheses, finder


@pytest.mark.parametrize(("gain", "replaces"), [(0.9 * SETTINGS.lead, False), (1.1 * SETTINGS.lead, True)])
def test_another_hypothesis_becomes_the_best_only_with_a_lead(gain: float, replaces: bool) -> None:
    other = hypothesis(POINTS_M[::-1], -gain)
    hypotheses, finder = followed(other)
    assert (hypotheses.best is other) == replaces
    assert hypotheses.labellings == 1 + replaces
    assert (hypotheses.changed is not None) == replaces
    assert hypotheses.best is not None and hypotheses.best.cost == 0.0
    hypotheses.step(MarkerFrame(2, 2.0))
    assert hypotheses.changed is None
    assert (hypotheses.best is finder.first) != replaces  # it is not exchanged back


def test_costs_add_up_until_a_hypothesis_is_hopeless() -> None:
    other = hypothesis(POINTS_M[::-1], 1.0)
    hypotheses, finder = followed(other)
    finder.costs = {other.lineage: 10.0}
    kept = []
    for number in range(2, 6):
        hypotheses.step(MarkerFrame(number, float(number)))
        kept.append(other in hypotheses.found)
    assert kept == [True, True, False, False]  # 11, 21, 31


@pytest.mark.parametrize(("apart_m", "same"), [(0.5 * SETTINGS.same_m, True), (2.0 * SETTINGS.same_m, False)])
def test_hypotheses_with_the_same_labels_and_body_are_one(apart_m: float, same: bool) -> None:
    hypotheses, _ = followed(hypothesis(cost=3.0, apart_m=apart_m))
    assert len(hypotheses.found) == (1 if same else 2)


def test_no_other_labels_are_looked_for_unless_asked() -> None:
    finder = Finder(hypothesis(), hypothesis(POINTS_M[::-1]))
    hypotheses = Hypotheses(finder)  # type: ignore[arg-type]
    for number in range(3):
        hypotheses.step(MarkerFrame(number, float(number)), checks=False)
    assert len(hypotheses.found) == len(finder.proposed) == 1
