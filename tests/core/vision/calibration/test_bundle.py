import numpy as np
import pytest
from perfanim.core.vision.calibration.bundle import (
    Bundle,
    CornerObservation,
    _residuals_and_jacobian,
    adjust,
    adjust_boards,
    residuals,
    rms,
)

GRID = np.stack([*np.meshgrid(np.arange(6) * 0.03, np.arange(5) * 0.03), np.zeros((5, 6))], axis=-1).reshape(-1, 3)


def truth(moments: int) -> Bundle:
    rng = np.random.default_rng(2)
    intrinsics = np.array(
        [[800.0, 805.0, 320.0, 240.0, 1.2, -0.05, 0.1, 0.001, -0.001, 0.02],
         [790.0, 792.0, 330.0, 235.0, -0.6, 0.04, -0.2, 0.002, 0.001, 0.1]]
    )  # fmt: skip
    cameras = np.array([np.zeros(6), [0.01, 0.1, -0.02, -0.3, 0.01, 0.02]])
    turns = rng.uniform(-0.6, 0.6, (moments, 3))
    places = rng.uniform([-0.2, -0.15, 0.7], [0.1, 0.1, 1.1], (moments, 3))
    return Bundle(intrinsics, cameras, np.concatenate((turns, places), axis=1))


def observations(bundle: Bundle, noise: float) -> list[CornerObservation]:
    rng = np.random.default_rng(3)
    rows = []
    for moment in range(len(bundle.boards)):
        for camera in range(2):
            exact = residuals(bundle, CornerObservation(camera, moment, GRID, np.zeros((len(GRID), 2))))
            rows.append(CornerObservation(camera, moment, GRID, exact + rng.normal(0, noise, exact.shape)))
    return rows


@pytest.mark.parametrize("camera", [0, 1])
def test_jacobian_equals_finite_differences(camera):
    bundle = truth(1)
    observation = CornerObservation(camera, 0, GRID, np.zeros((len(GRID), 2)))
    errors, jacobian = _residuals_and_jacobian(bundle, observation)
    step = 1e-6
    for column in range(22):
        parts = [bundle.intrinsics.copy(), bundle.cameras.copy(), bundle.boards.copy()]
        if column < 10:
            parts[0][camera, column] += step
        elif column < 16:
            parts[1][camera, column - 10] += step
        else:
            parts[2][0, column - 16] += step
        difference = (residuals(Bundle(*parts), observation) - errors).ravel() / step
        np.testing.assert_allclose(jacobian[:, column], difference, rtol=1e-4, atol=1e-2)


def test_adjustment_finds_cameras_with_skew():
    exact = truth(20)
    seen = observations(exact, 0.02)
    start = Bundle(
        exact.intrinsics * [1.02, 0.98, 1.01, 0.99, 0, 0, 0, 0, 0, 0],
        exact.cameras + np.array([np.zeros(6), [0.01, -0.01, 0.01, 0.01, -0.01, 0.01]]),
        exact.boards + 0.01,
    )
    found = adjust(start, seen, np.ones(10, dtype=bool))
    assert rms(found, seen) < 0.02 * np.sqrt(2) * 1.02
    # five sigmas of what 0.02 px of noise leaves, from the normal equations of this very set
    np.testing.assert_allclose(found.intrinsics[:, :2], exact.intrinsics[:, :2], atol=0.6)
    np.testing.assert_allclose(found.intrinsics[:, 4], exact.intrinsics[:, 4], atol=0.2)
    np.testing.assert_allclose(found.cameras[1], exact.cameras[1], atol=2e-3)


def test_adjusting_boards_keeps_the_cameras():
    exact = truth(4)
    seen = observations(exact, 0.0)
    moved = Bundle(exact.intrinsics, exact.cameras, exact.boards + 0.02)
    found = adjust_boards(moved, seen)
    np.testing.assert_array_equal(found.intrinsics, exact.intrinsics)
    np.testing.assert_allclose(found.boards, exact.boards, atol=1e-6)
