"""Points chosen for limb markers by the kernel are those of NumPy, digit by digit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.kernel.library import use_kernel
from perfanim.core.labelling.limb_choices import ChoiceLimits, cheapest_choices


def assert_same(pairs: np.ndarray, candidates: np.ndarray, limits: ChoiceLimits) -> int:
    """Require the same choices of both bodies; return how many there are."""
    expected = cheapest_choices.numpy_body(pairs, candidates, limits)
    found = cheapest_choices.compiled_body(pairs, candidates, limits)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    return found[0].shape[1]


def random_candidates(generator: np.random.Generator, placements: int, limbs: int, count: int) -> np.ndarray:
    """Return distinct points for each marker, some of them missing at the end, as the labeller pads them."""
    points = max(count, limbs) + 2
    found = np.argsort(generator.random((placements, limbs, points)), axis=2)[..., :count]
    missing = np.arange(count) >= generator.integers(0, count + 1, (placements, limbs, 1))
    return np.where(missing, -1, found)


@given(st.integers(0, 2**32), st.integers(1, 4), st.integers(1, 8), st.integers(0, 12), st.integers(1, 40))
def test_random_costs(seed, placements, limbs, count, kept):
    generator = np.random.default_rng(seed)
    candidates = random_candidates(generator, placements, limbs, count)
    pairs = generator.exponential(4.0, (placements, limbs, count + 1, limbs, count + 1)).astype(np.float32)
    if seed % 3 == 0:
        pairs = np.round(pairs)  # equal costs stay in order
    limits = ChoiceLimits(kept, int(generator.integers(1, kept + 1)), 10.0)
    assert 1 <= assert_same(pairs, candidates, limits) <= limits.best


@pytest.mark.parametrize("special", [np.inf, 1e30, -1e30, 0.0])
def test_hostile_costs(special):
    generator = np.random.default_rng(1)
    candidates = random_candidates(generator, 3, 5, 7)
    pairs = generator.exponential(4.0, (3, 5, 8, 5, 8)).astype(np.float32)
    pairs[:, 1:3, ::2] = special
    assert_same(pairs, candidates, ChoiceLimits(40, 6, 10.0))


def test_costs_that_are_no_numbers_leave_the_memory_alone():
    candidates = random_candidates(np.random.default_rng(2), 2, 4, 6)
    rows, costs = cheapest_choices.compiled_body(
        np.full((2, 4, 7, 4, 7), np.nan, dtype=np.float32), candidates, ChoiceLimits(40, 6, 10.0)
    )
    assert rows.shape == (2, 6, 4)
    assert costs.shape == (2, 6)
    assert use_kernel(True)
