"""Reflections are found by the motion that any camera shows."""

import numpy as np
from perfanim.core.subjects.setup_check.image_faults import moving_images, reflections
from perfanim.core.subjects.setup_check.spots import Spots

IMAGES, MARKERS = 40, 4


def film(still: int) -> Spots:
    """Return spots of walking markers, and of so many reflections, in each image."""
    rows = []
    for image in range(IMAGES):
        rows += [(image, 100.0 + 90.0 * marker + 3.0 * image, 200.0, 90.0) for marker in range(MARKERS)]
        rows += [(image, 50.0 * place, 400.0, 0.0) for place in range(still)]
    images, x, y, speed = np.array(rows).T
    count = len(rows)
    velocity = np.stack((speed, np.zeros(count)), axis=1)
    pixels, shape = np.stack((x, y), axis=1), np.tile(np.eye(2), (count, 1, 1))
    usual = np.full(count, 2.0)
    return Spots(images.astype(np.int64), pixels, np.full(count, 200.0), usual, usual, shape, velocity)


def test_a_camera_with_more_reflections_than_markers_is_judged_by_the_motion_of_the_other() -> None:
    left, right = film(still=MARKERS + 1), film(still=0)
    moving = moving_images([left, right])
    assert moving.tolist() == list(range(IMAGES))
    (found,) = reflections(0, "the left camera", left, moving)
    assert len(found.places) == MARKERS + 1
    assert reflections(1, "the right camera", right, moving) == []
    assert len(moving_images([left])) == 0


def test_nothing_is_named_while_nobody_moves() -> None:
    assert reflections(0, "the left camera", film(still=2), moving_images([])) == []
