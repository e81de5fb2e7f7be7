"""Torn images, whose lower part is still the last one's, are told; still or dark parts of pictures are not."""

from collections.abc import Callable

import numpy as np
import pytest
from perfanim.core.geometry.arrays import Image
from perfanim.core.vision.sources.camera_watch import CameraHealth

FPS = 60.0
BEGIN, END, COUNT = 90, 150, 240  # images
NOTE = "the right camera gives torn images"
NOISE, HEIGHTS = np.random.default_rng(2), np.random.default_rng(3)

Film = Callable[[int, Image, Image], Image]  # an image, of its number, the camera's image and the one before that


def told(film: Film, noise: int = 12) -> list[int]:
    """Return the numbers of images at which torn ones are told."""
    health = CameraHealth("the right camera", 1.0 / FPS, 0.0, (480, 32, 3))
    numbers, last = [], np.zeros((480, 32, 3), dtype=np.uint8)
    for number in range(COUNT):
        image = NOISE.integers(0, noise, last.shape, dtype=np.uint8)
        image[40:50, 10:14] = 220
        health.update(number / FPS, film(number, image, last))
        if health.note(number / FPS).startswith(NOTE):
            numbers.append(number)
        last = image
    return numbers


def torn(number: int, image: Image, last: Image) -> Image:
    edge = HEIGHTS.integers(480)
    return np.concatenate((image[:edge], last[edge:])) if BEGIN <= number < END else image


def test_torn_images_are_reported_within_a_quarter_of_a_second() -> None:
    numbers = told(torn)
    assert BEGIN < numbers[0] <= BEGIN + 0.25 * FPS
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert END - 0.25 * FPS < numbers[-1] < END + 0.5 * FPS


def dark_below(number: int, image: Image, last: Image) -> Image:
    image[240:] = 0
    return image


def still_below(number: int, image: Image, last: Image) -> Image:
    if number >= BEGIN:
        image[240:] = 7
    return image


def sometimes_still_below(number: int, image: Image, last: Image) -> Image:
    if number % 9:
        return image
    return np.concatenate((image[:240], last[240:]))


def torn_once(number: int, image: Image, last: Image) -> Image:
    return np.concatenate((image[:240], last[240:])) if number == BEGIN else image


def every_second_once_more(number: int, image: Image, last: Image) -> Image:
    image[:] = image if number % 2 else last
    return image


@pytest.mark.parametrize(
    "film",
    [dark_below, still_below, sometimes_still_below, torn_once, every_second_once_more],
    ids=lambda film: film.__name__,
)
def test_partly_unchanged_images_are_not_reported_as_torn(film: Film) -> None:
    assert told(film) == []
