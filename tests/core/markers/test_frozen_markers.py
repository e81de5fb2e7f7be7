"""Markers that stand exactly still while the body moves."""

import numpy as np
import pytest
from perfanim.core.markers.frozen_markers import FrozenMarkers

FPS = 60.0
FEET = np.array([False, False, False, False, True])


def walking(speed_m_s: float = 1.2) -> np.ndarray:
    """Markers (F, M, 3) of a body that walks."""
    path = speed_m_s / FPS * np.arange(60)[:, None, None] * np.array([1.0, 0.0, 0.0])
    return path + np.arange(len(FEET))[:, None] * np.array([0.0, 0.4, 0.0])


def frozen(points: np.ndarray) -> np.ndarray:
    """Return the mask (F, M) of frozen markers."""
    found = FrozenMarkers(FEET)
    return np.array([found.step(row, 1.0 / FPS) for row in points])


def test_a_frozen_marker_is_found_after_a_tenth_of_a_second_until_it_moves() -> None:
    points = walking()
    points[20:40, 2] = points[20, 2]
    found = frozen(points)
    assert np.flatnonzero(found[:, 2]).tolist() == list(range(26, 40))
    assert not np.delete(found, 2, axis=1).any()


@pytest.mark.parametrize("noise_m", [1e-6, 1e-3])
def test_a_marker_that_moves_at_all_is_not_frozen(noise_m: float) -> None:
    points = walking()
    points[20:, 2] = points[20, 2] + np.random.default_rng(1).normal(0.0, noise_m, (40, 3))
    assert not frozen(points).any()


def test_standing_feet_still_bodies_and_repeated_pictures_are_not_frozen() -> None:
    planted, still, repeated = walking(), walking(0.0), walking()
    planted[20:, 4] = planted[20, 4]
    repeated[1::2] = repeated[::2]
    for points in (planted, still, repeated):
        assert not frozen(points).any()


def test_hidden_markers_are_not_frozen() -> None:
    points = walking()
    points[20:, 2] = np.nan
    assert not frozen(points).any()
