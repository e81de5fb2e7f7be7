import numpy as np
import pytest
from perfanim.core.geometry.camera import Camera
from perfanim.core.geometry.triangulation import depths, inverse_3x3, triangulate

MATRIX = np.array([[800.0, 0.0, 640.0], [0.0, 800.0, 360.0], [0.0, 0.0, 1.0]])
SIGMA_PX = 0.5
CHANCE = np.random.default_rng(6)
POINTS_M = CHANCE.uniform(-1.0, 1.0, (40, 3))
TURNS_RAD = (-0.7, 0.1, 0.8)


def around(turn_rad: float) -> Camera:
    """Return a camera four metres off the origin that looks at it."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    rotation = np.array([[cos, 0.0, -sin], [0.0, -1.0, 0.0], [-sin, 0.0, -cos]])
    return Camera(f"at {turn_rad}", (1280, 720), MATRIX, np.zeros(5), rotation, np.array([0.0, 0.0, 4.0]))


CAMERAS = [around(turn_rad) for turn_rad in TURNS_RAD]


def seen_by(cameras: list[Camera], points_m: np.ndarray, noise_px: float = 0.0) -> np.ndarray:
    """Return normalised coordinates (N, C, 2) with noise."""
    pixels = np.stack([camera.project(points_m) for camera in cameras], axis=1)
    pixels += CHANCE.normal(0.0, 1.0, pixels.shape) * noise_px
    return (pixels - MATRIX[:2, 2]) / 800.0


def test_triangulation_is_exact() -> None:
    found, _, errors = triangulate(CAMERAS, seen_by(CAMERAS, POINTS_M), np.ones((40, 3)), SIGMA_PX)
    np.testing.assert_allclose(found, POINTS_M, atol=1e-9)
    np.testing.assert_allclose(errors, 0.0, atol=1e-6)


def test_points_at_the_cameras_own_height_or_straight_before_one_are_found_too() -> None:
    points = np.array([[0.4, 0.0, 0.2], [-0.3, 0.0, -0.5], [0.0, 0.0, 0.0], [0.0, 0.7, 0.0]])
    found, _, errors = triangulate(CAMERAS, seen_by(CAMERAS, points), np.ones((4, 3)), SIGMA_PX)
    np.testing.assert_allclose(found, points, atol=1e-9)
    np.testing.assert_allclose(errors, 0.0, atol=1e-6)


def test_cameras_without_weight_do_not_count() -> None:
    normalised, weights = seen_by(CAMERAS, POINTS_M), np.ones((40, 3))
    weights[::2, 0], normalised[::2, 0] = 0.0, np.nan
    weights[1::2, 2], normalised[1::2, 2] = 0.0, 7.0
    found, covariances, errors = triangulate(CAMERAS, normalised, weights, SIGMA_PX)
    np.testing.assert_allclose(found, POINTS_M, atol=1e-9)
    assert np.all(errors[weights == 0.0] == 0.0)
    _, of_three, _ = triangulate(CAMERAS, seen_by(CAMERAS, POINTS_M), np.ones((40, 3)), SIGMA_PX)
    assert np.all(np.trace(covariances, axis1=1, axis2=2) > np.trace(of_three, axis1=1, axis2=2))


def test_noisy_points_have_the_least_reprojection_error() -> None:
    normalised, weights = seen_by(CAMERAS, POINTS_M, 2.0), np.ones((40, 3))
    found, _, errors = triangulate(CAMERAS, normalised, weights, SIGMA_PX)
    pixels = normalised * 800.0 + MATRIX[:2, 2]
    off = np.stack([camera.project(found) for camera in CAMERAS], axis=1) - pixels
    np.testing.assert_allclose(errors, np.linalg.norm(off, axis=2), atol=1e-9)
    best = np.sum(errors**2, axis=1)
    for step in np.concatenate((np.eye(3), -np.eye(3))) * 1e-3:
        moved = np.stack([camera.project(found + step) for camera in CAMERAS], axis=1) - pixels
        assert np.all(np.sum(moved**2, axis=(1, 2)) > best)


def test_covariances_equal_the_scatter() -> None:
    point = np.array([[0.3, -0.2, 0.1]])
    many = np.repeat(point, 4000, axis=0)
    found, covariances, _ = triangulate(CAMERAS[:2], seen_by(CAMERAS[:2], many, SIGMA_PX), np.ones((4000, 2)), SIGMA_PX)
    spread = np.cov(found.T)
    # of 4,000 draws a variance is known to 2.2 %
    np.testing.assert_allclose(spread, covariances.mean(axis=0), atol=0.1 * np.trace(spread) / 3.0)


@pytest.mark.parametrize("known", [40, 20])
def test_result_does_not_depend_on_the_start(known: int) -> None:
    normalised, weights = seen_by(CAMERAS, POINTS_M, 1.0), np.ones((40, 3))
    start_m = POINTS_M + CHANCE.normal(0.0, 0.01, POINTS_M.shape)
    start_m[known:] = np.nan
    plain, _, _ = triangulate(CAMERAS, normalised, weights, SIGMA_PX)
    started, _, _ = triangulate(CAMERAS, normalised, weights, SIGMA_PX, start_m)
    np.testing.assert_allclose(started, plain, atol=1e-6)


def test_inverse_3x3_equals_numpys() -> None:
    halves = CHANCE.normal(size=(20, 3, 3))
    matrices = halves @ halves.transpose(0, 2, 1)
    np.testing.assert_allclose(inverse_3x3(matrices), np.linalg.inv(matrices), rtol=1e-6)


def test_depth_is_along_the_cameras_axis() -> None:
    for camera in CAMERAS:
        np.testing.assert_allclose(depths(camera, POINTS_M), camera.to_camera(POINTS_M)[:, 2])
