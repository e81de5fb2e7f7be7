"""Markers that leave the body for a moment, against those that return after a while or move with the body."""

import numpy as np
import pytest
from perfanim.core.markers.marker_set import PointKind
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.session.leaving_markers import leaves_body

FRAMES, AT = 60, 30
MARKERS = noise_of(PointKind.MARKERS)


def swinging(fps: float) -> np.ndarray:
    """Return two markers (F, 2, 3) of a hand that swings by 30 cm to either side, once a second."""
    phase = 2.0 * np.pi * np.arange(FRAMES) / fps
    path = np.stack((0.3 * np.sin(phase), 0.1 * np.cos(phase), np.zeros(FRAMES)), axis=-1)
    return path[:, None] + np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.2]])


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
@pytest.mark.parametrize("frames", [1, 2])
@pytest.mark.parametrize("judged", [False, True])
def test_a_marker_that_is_elsewhere_for_a_moment_leaves_the_body(fps, frames, judged):
    worn_m = swinging(fps)
    seen_m = worn_m + np.random.default_rng(1).normal(0.0, 0.002, worn_m.shape)
    seen_m[AT : AT + frames, 0] += [0.0, 0.08, 0.0]
    found = leaves_body(seen_m, worn_m, fps, MARKERS, judged)
    assert np.argwhere(found).tolist() == [[frame, 0] for frame in range(AT, AT + frames)]


@pytest.mark.parametrize("frame", [0, FRAMES - 1])
def test_the_first_and_the_last_frame_are_compared_with_their_neighbours(frame):
    seen_m = swinging(60.0)
    seen_m[frame, 0] += [0.0, 0.08, 0.0]
    found = leaves_body(seen_m, swinging(60.0), 60.0, MARKERS, True)
    assert np.argwhere(found).tolist() == [[frame, 0]]


def test_a_marker_that_stays_elsewhere_has_slid():
    seen_m = swinging(60.0)
    seen_m[AT:, 0] += [0.0, 0.08, 0.0]
    assert not leaves_body(seen_m, swinging(60.0), 60.0, MARKERS, True).any()


def test_a_body_that_comes_back_to_its_standing_marker_moves_and_not_the_marker():
    seen_m = np.zeros((FRAMES, 1, 3))
    seen_m[AT - 20 : AT] = np.nan
    worn_m = np.zeros((FRAMES, 1, 3))
    worn_m[AT - 20 : AT + 4, 0, 0] = [*np.linspace(0.0, 0.2, 20), 0.2, 0.14, 0.08, 0.02]
    assert not leaves_body(seen_m, worn_m, 60.0, MARKERS, False).any()


def test_a_limb_that_the_body_follows_badly_does_not_leave_it():
    """A hand that shakes at 12 Hz about a body that is low-passed: every step is as large as the next."""
    shakes = np.zeros((FRAMES, 1, 3))
    shakes[:, 0, 0] = 0.05 * np.sin(2.0 * np.pi * 12.0 * np.arange(FRAMES) / 60.0)
    worn_m = np.zeros_like(shakes)
    assert leaves_body(shakes, worn_m, 60.0, MARKERS, False).any()
    assert not leaves_body(shakes, worn_m, 60.0, MARKERS, True).any()
