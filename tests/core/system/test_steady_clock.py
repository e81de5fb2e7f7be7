"""Time stamps that come late by chance."""

import numpy as np
from perfanim.core.system.steady_clock import SteadyClock


def test_chance_delays_are_evened_out_and_lost_frames_kept() -> None:
    rng = np.random.default_rng(3)
    numbers = np.delete(np.arange(600), [200, 201, 350, 500])
    true = numbers / 59.7
    late = rng.normal(0.0, 0.002, len(true))
    clock = SteadyClock()
    found = np.array([clock.steady(stamp) for stamp in true + late])
    # the newest end of a line through 60 stamps has half of a stamp's deviation and less: sqrt(4 / 60) = 0.26
    assert np.std((found - true)[60:]) < 0.5 * 0.002
    assert np.abs(found - true).max() < 4 * 0.002


def test_a_camera_that_changes_its_rate_is_followed_at_once() -> None:
    true = np.concatenate((np.arange(200) / 60.0, 200 / 60.0 + np.arange(100) / 15.0))
    clock = SteadyClock()
    found = np.array([clock.steady(stamp) for stamp in true])
    assert np.abs(found - true).max() < 0.3 / 15.0
    np.testing.assert_allclose(found[230:], true[230:], atol=0.001)
