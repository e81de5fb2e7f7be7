"""The kernel finds the same pixels as OpenCV, in whole images and in parts of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.vision.detection.foreground import differing


def assert_same(image: np.ndarray, low: np.ndarray, width: np.ndarray) -> None:
    expected, found = differing.numpy_body(image, low, width), differing.compiled_body(image, low, width)
    np.testing.assert_array_equal(found[0], expected[0])
    assert found[1:] == expected[1:]


@given(st.integers(0, 2**32), st.integers(1, 20), st.integers(1, 70), st.sampled_from([0.0, 0.001, 0.05, 1.0]))
def test_random_images(seed, height, columns, share):
    generator = np.random.default_rng(seed)
    low, width = generator.integers(0, 256, (2, height, columns, 3), dtype=np.uint8)
    image = low + (width * generator.random(low.shape)).astype(np.uint8)  # inside the band, which may wrap around
    other = generator.random(low.shape) < share
    image[other] = generator.integers(0, 256, np.count_nonzero(other))
    assert_same(image, low, width)


@pytest.mark.parametrize("column", [0, 1, 15, 16, 31, 32, 36, 37])
@pytest.mark.parametrize("channel", [0, 1, 2])
@pytest.mark.parametrize("value", [19, 31])
def test_one_pixel_below_or_above(column, channel, value):
    image = np.full((3, 38, 3), 25, dtype=np.uint8)
    low, width = np.full_like(image, 20), np.full_like(image, 10)
    image[1, column, channel] = value
    assert_same(image, low, width)
    mask, first, last = differing.compiled_body(image, low, width)
    assert (first, last, mask.sum()) == (column, column, 255)
    image[1, column, channel] = 20 if value < 20 else 30
    assert differing.compiled_body(image, low, width)[1:] == (0, -1)


def test_a_part_of_an_image():
    image, low, width = np.random.default_rng(3).integers(0, 256, (3, 40, 90, 3), dtype=np.uint8)
    part = slice(7, 33), slice(11, 64)
    assert_same(image[part], np.ascontiguousarray(low[part]), width[part])


def test_pixels_that_lie_otherwise_in_memory():
    image, low, width = np.random.default_rng(4).integers(0, 256, (3, 12, 30, 3), dtype=np.uint8)
    assert_same(image[..., ::-1], low, width)
    assert_same(image[:, ::2], low[:, ::2], width[:, ::2])
