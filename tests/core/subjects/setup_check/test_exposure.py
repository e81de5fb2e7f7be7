"""The exposure is estimated by the streaks of markers, also of a performer who only walks."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.subjects.setup_check.image_faults import estimate_exposure_s, sharpness_faults
from perfanim.core.subjects.setup_check.spots import Spots

COUNT = 60


def spots(speed_px_s: float, exposure_s: float) -> Spots:
    """Return round spots that move in all directions and leave streaks."""
    angles = np.linspace(0.0, 2.0 * np.pi, COUNT, endpoint=False)
    along = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    streaks = (speed_px_s * exposure_s) ** 2 / 12.0 * along[:, :, None] * along[:, None, :]
    return Spots(
        np.arange(COUNT), 300.0 + 50.0 * along, np.full(COUNT, 200.0), np.full(COUNT, 2.0), np.full(COUNT, 2.0),
        0.8 * np.eye(2) + streaks, speed_px_s * along,
    )  # fmt: skip


@pytest.mark.parametrize("speed_px_s", [90.0, 130.0, 400.0])
@pytest.mark.parametrize("exposure_s", [0.014, 0.025])
def test_a_slow_shutter_is_named_at_each_speed(speed_px_s: float, exposure_s: float) -> None:
    assert estimate_exposure_s(spots(speed_px_s, exposure_s)) == pytest.approx(exposure_s)
    (found,) = sharpness_faults("the left camera", spots(speed_px_s, exposure_s))
    assert f"about {1000.0 * exposure_s:.0f} ms" in found.text


@pytest.mark.parametrize(("speed_px_s", "exposure_s"), [(60.0, 0.025), (90.0, 0.004), (130.0, 0.004), (400.0, 0.004)])
def test_nobody_who_stands_and_no_short_exposure_is_named(speed_px_s: float, exposure_s: float) -> None:
    assert sharpness_faults("the left camera", spots(speed_px_s, exposure_s)) == []


@pytest.mark.parametrize(("radius_px", "named"), [(2.0, True), (1.25, True), (1.0, False)])
def test_streaks_of_small_markers_are_judged_but_not_of_tiny_ones(radius_px: float, named: bool) -> None:
    small = replace(spots(130.0, 0.020), radius_px=np.full(COUNT, radius_px))
    assert bool(sharpness_faults("the left camera", small)) is named
