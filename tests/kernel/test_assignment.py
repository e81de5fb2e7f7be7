"""The cheapest assignment by the kernel has the sum of NumPy's, and of SciPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.geometry.gated_assignment import assign
from scipy.optimize import linear_sum_assignment

BODIES = assign.numpy_body, assign.compiled_body


@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.sampled_from([0, 1, 2, 9, 40]),
    columns=st.sampled_from([0, 1, 3, 40, 70]),
    kind=st.sampled_from(["random", "ties", "equal", "far", "blocks", "forbidden", "NaN"]),
    gate=st.sampled_from([1e-3, 0.5, 1.0, 1e9]),
)
def test_any_costs(seed: int, rows: int, columns: int, kind: str, gate: float) -> None:
    generator = np.random.default_rng(seed)
    costs = generator.uniform(size=(rows, columns))
    if kind == "ties":
        costs = np.rint(4.0 * costs)
    elif kind == "equal":
        costs = np.ones_like(costs)
    elif kind == "far":
        costs = np.where(costs < 0.9, 1.0, costs)
    elif kind == "blocks":
        costs += 1e6 * (np.arange(rows)[:, None] % 3 != np.arange(columns) % 3)
    elif kind in ("forbidden", "NaN"):
        costs[generator.uniform(size=costs.shape) < 0.3] = np.inf if kind == "forbidden" else np.nan
    limited = np.where(costs < gate, costs, gate)
    best = (gate - limited)[linear_sum_assignment(limited)].sum()
    for body in BODIES:
        found, among = body(costs, gate)
        assert (found.dtype, among.dtype) == (np.int64, np.int64)
        assert np.all(np.diff(found) > 0)
        assert len(np.unique(among)) == len(among) == len(found)
        assert np.all(costs[found, among] < gate)
        assert (gate - costs[found, among]).sum() == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("shape", [(2, 3), (3, 2)])
def test_costs_that_are_infinitely_low_are_refused(shape: tuple[int, int]) -> None:
    costs = np.zeros(shape)
    costs[1, 1] = -np.inf
    for body in BODIES:
        with pytest.raises(np.linalg.LinAlgError):
            body(costs)


def test_sums_that_are_too_large_end() -> None:
    costs = np.array([[-1.7e308, 1.7e308, 0.0], [-1.7e308, 1.7e308, 1.7e308], [-1.7e308, 0.0, 1.7e308]])
    for body in BODIES:
        try:
            with np.errstate(all="ignore"):
                assert len(body(costs, 1.75e308)[0]) == 3
        except np.linalg.LinAlgError:
            pass
