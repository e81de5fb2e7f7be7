import numpy as np
import pytest
from perfanim.core.markers.marker_set import PointKind
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.solver.observation import Observation, control_jacobian, control_residual, control_sigmas
from perfanim.core.solver.subject_model import ROOT_AT_REST

STEP = 1e-6


@pytest.fixture
def mixed(true_markers, stage_rig):
    """Of eight markers one is hidden, two are seen by one camera each, the others are located with an error."""
    points = true_markers[0] + np.random.default_rng(0).normal(scale=0.01, size=(8, 3))
    cameras = np.full(8, -1)
    cameras[[2, 5]] = 0, 1
    image_points = np.full((8, 2), np.nan)
    for marker in (2, 5):
        camera = stage_rig.cameras[cameras[marker]]
        image_points[marker] = camera.undistort(camera.project(points[marker]))
    points[[2, 5, 7]] = np.nan
    return Observation(points, cameras, image_points, stage_rig.cameras)


def test_markers_are_located_single_or_hidden(mixed):
    np.testing.assert_array_equal(mixed.located, [1, 1, 0, 1, 1, 0, 1, 0])
    np.testing.assert_array_equal(mixed.single, [0, 0, 1, 0, 0, 1, 0, 0])
    points = Observation.of_points(mixed.points_m)
    assert not points.single.any()
    assert len(control_residual(points, np.zeros((8, 3)))) == 15


def test_residual_is_zero_where_the_markers_are(true_markers, stage_rig, mixed):
    exact = Observation(np.where(np.isnan(mixed.points_m), np.nan, true_markers[0]), mixed.cameras,
                        mixed.image_points, mixed.rig)  # fmt: skip
    on_ray = exact.single[exact.controls.markers]
    assert np.abs(control_residual(exact, true_markers[0])[~on_ray]).max() == 0.0
    # the single-camera markers were seen a centimetre off: across the ray they differ by no more than that
    across = control_residual(exact, true_markers[0])[on_ray].reshape(2, 2)
    assert np.all(np.linalg.norm(across, axis=1) < 0.03)
    assert len(control_residual(mixed, true_markers[0])) == 3 * 5 + 2 * 2


def test_single_camera_marker_is_free_along_its_ray(true_markers, mixed):
    camera = mixed.rig[0]
    ray, of_it = camera.rays(mixed.image_points[2]), mixed.controls.markers == 2
    for depth in (2.0, 3.5, 6.0):
        markers = true_markers[0].copy()
        markers[2] = camera.centre_m + depth * ray
        assert np.abs(control_residual(mixed, markers)[of_it]).max() < 1e-9
        markers[2] += np.array([0.0, 0.05, 0.0])  # 5 cm upwards, nearly across the ray
        assert np.linalg.norm(control_residual(mixed, markers)[of_it]) == pytest.approx(0.05, rel=0.1)


def test_back_projection_is_the_closest_point_on_the_ray(true_markers, mixed):
    markers = true_markers[0] + np.random.default_rng(2).normal(scale=0.05, size=(8, 3))
    placed = mixed.back_projected(markers)
    np.testing.assert_array_equal(placed.points_m[[0, 1, 3, 4, 6, 7]], mixed.points_m[[0, 1, 3, 4, 6, 7]])
    for marker in (2, 5):
        camera = mixed.rig[mixed.cameras[marker]]
        ray = camera.rays(mixed.image_points[marker])
        np.testing.assert_allclose(np.cross(placed.points_m[marker] - camera.centre_m, ray), 0.0, atol=1e-12)
        assert (placed.points_m[marker] - markers[marker]) @ ray == pytest.approx(0.0, abs=1e-12)


def test_marker_noise_adds_to_the_least_deviation(mixed):
    noise_m = 0.004 * np.arange(8)
    noisy = mixed.smoothed(mixed.points_m + 1.0, noise_m, noise_of(PointKind.MARKERS))
    np.testing.assert_array_equal(noisy.points_m, mixed.points_m + 1.0)
    expected_m = np.hypot(0.003, np.where(mixed.single, 0.0, noise_m))
    np.testing.assert_allclose(control_sigmas(noisy, 0.003), expected_m[noisy.controls.markers])
    np.testing.assert_allclose(control_sigmas(mixed, 0.003), 0.003)
    source = noise_of(PointKind.KEYPOINTS)
    on_ray = mixed.single[mixed.controls.markers]
    across = control_sigmas(mixed.smoothed(mixed.points_m, noise_m, source), 0.003)[on_ray]
    assert len(across) == 4
    np.testing.assert_allclose(across, np.hypot(0.003, source.across_m))


@pytest.fixture
def guessed(true_markers, stage_rig):
    """Markers that one camera sees, placed 10 % too far away."""
    camera = stage_rig.cameras[0]
    points_m = camera.centre_m + 1.1 * (true_markers[0] - camera.centre_m)
    image_points = camera.undistort(camera.project(true_markers[0]))
    return Observation(points_m, np.zeros(8, dtype=np.int64), image_points, (camera,))


def test_guessed_depths_differ_along_the_rays_only(true_markers, guessed):
    away_m = control_residual(guessed, true_markers[0]).reshape(8, 3)
    depths_m = guessed.rig[0].to_camera(true_markers[0])[:, 2]
    np.testing.assert_allclose(away_m[:, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(away_m[:, 2], -0.1 * depths_m)
    source = noise_of(PointKind.KEYPOINTS)
    sigmas_m = control_sigmas(guessed.smoothed(guessed.points_m, np.full(8, 0.02), source), 0.0).reshape(8, 3)
    np.testing.assert_allclose(sigmas_m, [[0.02, 0.02, source.guessed_m]] * 8)


def test_guessed_depths_come_nearer_to_those_of_the_last_pose(true_markers, guessed):
    placed = guessed.back_projected(true_markers[0])
    before_m, after_m = (np.linalg.norm(each.points_m - true_markers[0], axis=1) for each in (guessed, placed))
    assert np.all(after_m < 0.5 * before_m)
    np.testing.assert_allclose(guessed.without_guesses().back_projected(true_markers[0]).points_m, true_markers[0])


@pytest.mark.parametrize("kind", ["mixed", "guessed"])
def test_jacobian_is_the_derivative_of_the_residual(model, kind, request):
    mixed = request.getfixturevalue(kind)
    pose = np.random.default_rng(1).normal(scale=0.3, size=(28, 3))

    def residual(change):
        return control_residual(mixed, model.markers(pose + change.reshape(28, 3)))

    _, full = model.markers_and_jacobian(pose, ROOT_AT_REST)
    expected = np.stack([(residual(c) - residual(-c)) / (2.0 * STEP) for c in STEP * np.eye(84)], axis=-1)
    # values of some metres: rounding of 1e-15 over the step
    np.testing.assert_allclose(control_jacobian(mixed, full)[:, 6:], expected, atol=1e-8)


def test_residual_without_markers_is_empty():
    nothing = Observation.of_points(np.full((3, 3), np.nan))
    assert control_residual(nothing, np.zeros((3, 3))).shape == (0,)
    assert control_jacobian(nothing, np.zeros((3, 3, 5))).shape == (0, 5)
