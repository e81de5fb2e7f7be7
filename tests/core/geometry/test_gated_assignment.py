import numpy as np
import pytest
from perfanim.core.geometry.gated_assignment import assign


def pairs(costs, gate=1.0):
    rows, columns = assign(costs, gate)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def test_the_sum_of_costs_is_least():
    # the nearest pair first would leave 0.9 for the other
    assert pairs([[0.1, 0.2], [0.2, 0.9]]) == [(0, 1), (1, 0)]


def test_a_pair_at_or_above_the_gate_is_left_out():
    assert pairs([[0.5, 3.0], [3.0, 1.0]]) == [(0, 0)]
    assert pairs([[2.0]], gate=2.0) == []
    assert pairs([[2.0]], gate=2.1) == [(0, 0)]


def test_the_usual_gate_is_one():
    rows, _ = assign([[0.999]])
    assert rows.tolist() == [0]
    rows, _ = assign([[1.0]])
    assert rows.tolist() == []


def test_one_far_pair_does_not_drive_near_ones_apart():
    # without the gate 0.4 + 0.4 + 9.0 would lose to 0.5 + 3.0 + 3.0
    costs = [[0.4, 9.0, 0.5], [9.0, 0.4, 9.0], [3.0, 3.0, 9.0]]
    assert pairs(costs) == [(0, 0), (1, 1)]


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_empty_tables_are_assigned(shape):
    rows, columns = assign(np.empty(shape))
    assert rows.shape == columns.shape == (0,)
    assert rows.dtype.kind == "i"


def test_forbidden_pairs_may_be_infinite():
    assert pairs([[np.inf, 0.3], [np.inf, 0.2]]) == [(1, 1)]
