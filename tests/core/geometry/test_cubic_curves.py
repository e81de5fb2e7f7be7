"""Cubic curves, with SciPy as second opinion."""

import numpy as np
import pytest
from perfanim.core.geometry.cubic_curves import cubic_spline, hermite
from scipy.interpolate import CubicHermiteSpline, CubicSpline

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("count", [4, 5, 9, 160])
def test_the_spline_through_uneven_knots_is_scipys(count: int) -> None:
    knots, values = np.cumsum(RNG.uniform(0.1, 1.0, count)), RNG.normal(size=(count, 3, 2))
    places = RNG.uniform(knots[0] - 0.1, knots[-1] + 0.1, 200)
    expected = CubicSpline(knots, values)(places)
    np.testing.assert_allclose(cubic_spline(knots, values, places), expected, rtol=0.0, atol=1e-11)


def test_a_cubic_is_met_exactly_also_at_the_knots() -> None:
    knots = np.array([-1.0, 0.0, 0.5, 2.0, 2.5])
    places = np.concatenate((knots, [-0.7, 1.3]))
    np.testing.assert_allclose(cubic_spline(knots, knots**3 - knots, places), places**3 - places, atol=1e-13)


@pytest.mark.parametrize("count", [2, 3, 30])
def test_a_curve_with_given_slopes_is_scipys(count: int) -> None:
    knots, values, slopes = np.cumsum(RNG.uniform(0.1, 1.0, count)), *RNG.normal(size=(2, count, 3))
    places = RNG.uniform(knots[0] - 0.1, knots[-1] + 0.1, 100)
    expected = CubicHermiteSpline(knots, values, slopes)(places)
    np.testing.assert_allclose(hermite(knots, values, slopes, places), expected, rtol=0.0, atol=1e-11)
