"""Filters along the frames, with SciPy as second opinion."""

import numpy as np
import pytest
from perfanim.core.body.window_filters import frames_to, gaussian, largest, smallest, usual
from scipy import ndimage

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("frames", [1, 2, 5, 40, 500])
@pytest.mark.parametrize("sigma", [0.4, 1.0, 7.3, 60.0])
@pytest.mark.parametrize(("border", "mode"), [("edge", "nearest"), ("symmetric", "reflect")])
def test_gaussian_means_are_scipys(frames: int, sigma: float, border: str, mode: str) -> None:
    values = RNG.normal(size=(frames, 3, 2))
    expected = ndimage.gaussian_filter1d(values, sigma, axis=0, mode=mode)
    np.testing.assert_allclose(gaussian(values, sigma, border), expected, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("frames", [1, 2, 5, 40, 500])
@pytest.mark.parametrize("radius", [0, 1, 2, 3, 7, 30])
def test_extremes_and_the_usual_flag_are_scipys(frames: int, radius: int) -> None:
    values, size = RNG.normal(size=(frames, 3)), 2 * radius + 1
    np.testing.assert_array_equal(
        largest(values, radius), ndimage.maximum_filter1d(values, size, axis=0, mode="nearest")
    )
    np.testing.assert_array_equal(
        smallest(values, radius), ndimage.minimum_filter1d(values, size, axis=0, mode="nearest")
    )
    flags = values > 0.3
    np.testing.assert_array_equal(usual(flags, radius), ndimage.median_filter(flags, (size, 1), mode="nearest"))


def test_infinite_values_are_kept() -> None:
    np.testing.assert_array_equal(smallest(np.array([np.inf, np.inf, 1.0, np.inf]), 1), [np.inf, 1.0, 1.0, 1.0])


@pytest.mark.parametrize("frames", [1, 2, 40])
def test_frames_to_the_nearest_flag_are_scipys(frames: int) -> None:
    for _ in range(10):
        flags = RNG.random(frames) < 0.2
        flags[RNG.integers(frames)] = True
        np.testing.assert_array_equal(frames_to(flags), ndimage.distance_transform_edt(~flags))
