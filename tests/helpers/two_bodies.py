"""Comparison of the two bodies of a stage."""

import contextlib
from typing import Any

import numpy as np
from perfanim.core.kernel.library import Stage


def assert_same(stage: Stage[..., Any], *arguments: Any, rounding: float = 1e-10) -> None:
    """Require equal shapes, types, and values where NumPy's are finite, within a share of their magnitude.

    NumPy computes some products with zeros that the kernel leaves out, so infinite input may spread further there.
    """
    with np.errstate(all="ignore"):
        expected, found = (body(*arguments) for body in (stage.numpy_body, stage.compiled_body))
    pairs = list(zip(expected, found, strict=True)) if isinstance(expected, tuple) else [(expected, found)]
    for mine, theirs in pairs:
        assert mine.shape == theirs.shape
        assert mine.dtype == theirs.dtype
        known = np.isfinite(mine)
        assert np.isfinite(theirs[known]).all()
        largest = np.abs(mine[known]).max(initial=0.0).astype(np.float64)
        np.testing.assert_allclose(theirs[known], mine[known], rtol=0.0, atol=rounding * max(1.0, largest))


def assert_alike(stage: Stage[..., Any], *arguments: Any, rounding: float = 1e-10) -> None:
    """Require the same as `assert_same`; where one body refuses a matrix, the other may also return what is not finite.

    Whether NaN makes a Cholesky decomposition fail depends on NumPy's LAPACK.
    """
    results = []
    for body in (stage.numpy_body, stage.compiled_body):
        with np.errstate(all="ignore"), contextlib.suppress(np.linalg.LinAlgError):
            results.append(body(*arguments))
    if len(results) == 2:
        assert_same(stage, *arguments, rounding=rounding)
    for result in results[: len(results) % 2]:
        assert not all(np.isfinite(each).all() for each in result)


def spoiled(values: np.ndarray, special: float | None, place: int) -> np.ndarray:
    """Return a copy with one special value in it, if any."""
    result = values.copy()
    if special is not None and result.size:
        result.flat[place % result.size] = special
    return result
