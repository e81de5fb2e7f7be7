import numpy as np
import pytest
from perfanim.core.markers.marker_noise import MarkerNoise, marker_noise

RATES = (30.0, 60.0, 120.0)
SIGMAS_MM = np.array([0.1, 1.0, 3.0, 3.0])


def swinging(times_s: np.ndarray) -> np.ndarray:
    """Four markers (F, M, 3) of arms that swing 0.3 m each way, once a second."""
    phases = 2.0 * np.pi * (times_s[:, None] + np.arange(4) / 4.0)
    return 0.3 * np.stack((np.sin(phases), np.cos(phases), np.zeros_like(phases)), axis=-1)


def noisy(times_s: np.ndarray, seed: int = 3) -> np.ndarray:
    positions = swinging(times_s)
    return positions + 1e-3 * SIGMAS_MM[:, None] * np.random.default_rng(seed).normal(size=positions.shape)


@pytest.mark.parametrize("fps", RATES)
def test_noise_of_fast_arms_at_any_rate_and_with_gaps(fps):
    times_s = np.arange(round(8.0 * fps)) / fps
    positions = noisy(times_s)
    positions[np.random.default_rng(5).random(positions.shape[:2]) < 0.1] = np.nan
    np.testing.assert_allclose(1e3 * marker_noise(times_s, positions), SIGMAS_MM, rtol=0.15, atol=0.12)


def test_irregular_times_are_not_noise():
    times_s = np.arange(480) / 60.0 + np.random.default_rng(1).uniform(-0.003, 0.003, 480)
    assert 1e3 * marker_noise(times_s, swinging(times_s)).max() < 0.15


def test_live_noise_equals_the_takes_and_follows_changes():
    times_s = np.arange(240) / 60.0
    positions = noisy(times_s)
    positions[120:] = noisy(times_s, 4)[120:] * [[[1.0], [1.0], [1.0], [np.nan]]]
    positions[120:, 0] += np.random.default_rng(2).normal(0.0, 0.003, (120, 3))
    noise = MarkerNoise()
    found_mm = 1e3 * np.array([noise.step(*frame) for frame in zip(times_s, positions, strict=True)])
    assert np.all(found_mm[:6] == 0.0)  # too little is known
    np.testing.assert_allclose(found_mm[7:12], np.median(SIGMAS_MM), rtol=0.7)  # that of all together
    np.testing.assert_allclose(np.median(found_mm[60:120], axis=0), SIGMAS_MM, rtol=0.25, atol=0.1)
    assert np.median(found_mm[185:, 0]) == pytest.approx(3.0, rel=0.25)
    assert np.all(found_mm[185:, 3] > 0.9)  # hidden: as the others
