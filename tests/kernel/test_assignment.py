"""The cheapest assignment by the kernel has the sum of NumPy's, and of SciPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.geometry.gated_assignment import cheapest_columns
from scipy.optimize import linear_sum_assignment


@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.sampled_from([0, 1, 2, 9, 40]),
    more=st.sampled_from([0, 1, 30]),
    kind=st.sampled_from(["random", "ties", "equal", "far", "blocks"]),
)
def test_any_costs(seed: int, rows: int, more: int, kind: str) -> None:
    generator = np.random.default_rng(seed)
    costs = generator.uniform(size=(rows, rows + more))
    if kind == "ties":
        costs = np.rint(4.0 * costs)
    elif kind == "equal":
        costs = np.ones_like(costs)
    elif kind == "far":
        costs = np.where(costs < 0.9, 1.0, costs)
    elif kind == "blocks":
        costs += 1e6 * (np.arange(rows)[:, None] % 3 != np.arange(rows + more) % 3)
    best = costs[linear_sum_assignment(costs)].sum()
    for body in (cheapest_columns.numpy_body, cheapest_columns.compiled_body):
        columns = body(costs)
        assert columns.dtype == np.int64
        assert len(np.unique(columns)) == rows
        assert np.all((columns >= 0) & (columns < rows + more))
        assert costs[np.arange(rows), columns].sum() == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("special", [np.nan, np.inf, -np.inf])
def test_costs_that_are_not_finite_are_refused(special: float) -> None:
    costs = np.array([[0.0, 1.0], [0.0, special]])
    for body in (cheapest_columns.numpy_body, cheapest_columns.compiled_body):
        with pytest.raises(np.linalg.LinAlgError):
            body(costs)


def test_sums_that_are_too_large_end() -> None:
    costs = np.array([[-1.7e308, 1.7e308, 0.0], [-1.7e308, 1.7e308, 1.7e308], [-1.7e308, 0.0, 1.7e308]])
    for body in (cheapest_columns.numpy_body, cheapest_columns.compiled_body):
        try:
            with np.errstate(all="ignore"):
                assert len(np.unique(body(costs))) == 3
        except np.linalg.LinAlgError:
            pass
