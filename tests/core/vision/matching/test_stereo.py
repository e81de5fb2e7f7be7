import numpy as np
import pytest
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.vision.matching.stereo import StereoMatcher, epipolar_distances, essential_matrix


def body(seed: int = 0) -> np.ndarray:
    """Twelve points of a person's size, 3 m away."""
    rng = np.random.default_rng(seed)
    return rng.uniform([-0.5, -0.7, -3.2], [0.5, 0.7, -2.8], (12, 3))


def seen(rig: CameraRig, points: np.ndarray, noise: float, seed: int = 0) -> list[np.ndarray]:
    """Blobs (n, 5) of the points in each camera, with noise in pixels."""
    rng = np.random.default_rng(seed)
    rows = []
    for camera in rig.cameras:
        pixels = camera.project(points) + rng.normal(0, noise, (len(points), 2))
        looks = np.tile([4.0, 200.0, 0.0], (len(points), 1))
        rows.append(np.concatenate((pixels, looks), axis=1).astype(np.float32))
    return rows


def normalised(rig: CameraRig, points: np.ndarray) -> np.ndarray:
    return np.stack([camera.undistort(camera.project(points)) for camera in rig.cameras], axis=1)


def test_epipolar_distance_is_the_pixel_error(rig):
    coordinates = normalised(rig, body())
    pair = essential_matrix(*rig.cameras), float(np.mean([camera.focal_px for camera in rig.cameras]))
    distances = epipolar_distances(*pair, coordinates[:, 0], coordinates[:, 1])
    assert np.abs(np.diag(distances)).max() < 1e-6
    moved = coordinates[:, 1] + [0.0, 2.0 / rig.cameras[1].focal_px]
    off = np.diag(epipolar_distances(*pair, coordinates[:, 0], moved))
    # Sampson shares the error between the two images: 2 px in one is 2 / sqrt(2)
    np.testing.assert_allclose(off, np.sqrt(2.0), rtol=0.1)


@pytest.mark.parametrize("seed", range(8))
def test_blobs_in_different_order_are_matched(rig, seed):
    points = body(seed)
    blobs = seen(rig, points, 0.1, seed)
    order = np.random.default_rng(seed).permutation(12)
    blobs[1] = blobs[1][order]
    matcher = StereoMatcher(rig)
    # what was found a frame ago, 3 cm away: where epipolar lines alone are ambiguous this decides
    predicted = points + np.random.default_rng(seed + 50).normal(0, 0.02, points.shape)
    matches = matcher.match(blobs, matcher.undistort(blobs), predicted)
    assert len(matches.points_m) == 12
    np.testing.assert_array_equal(order[matches.blobs[:, 1]], matches.blobs[:, 0])
    assert np.linalg.norm(matches.points_m - points[matches.blobs[:, 0]], axis=1).max() < 0.01


def test_colour_resolves_ambiguous_epipolar_lines(rig):
    left, right = rig.cameras
    # two points whose images lie on one epipolar line: both on the plane through the two centres
    points = np.array([[-0.1, 0.0, -3.0], [0.12, 0.0, -3.0], [0.0, 0.6, -3.0], [0.1, -0.6, -3.0]])
    blobs = seen(rig, points, 0.0)
    for rows in blobs:
        rows[:, 4] = [10.0, 100.0, 60.0, 60.0]
    matcher = StereoMatcher(rig)
    matches = matcher.match(blobs, matcher.undistort(blobs), None)
    np.testing.assert_array_equal(matches.blobs[:, 0], matches.blobs[:, 1])
    assert left is not right


def test_blobs_of_one_camera_stay_unmatched(rig):
    points = body(3)
    blobs = seen(rig, points, 0.1)
    hidden = blobs[1][:9]
    matcher = StereoMatcher(rig)
    rows = [blobs[0], hidden]
    matches = matcher.match(rows, matcher.undistort(rows), points)
    assert sorted(matches.blobs[:, 0]) == list(range(9))
    assert matcher.match(
        [blobs[0], blobs[1][:0]], matcher.undistort([blobs[0], blobs[1][:0]]), None
    ).points_m.shape == (0, 3)


def test_third_camera_makes_points_more_exact(rig):
    from dataclasses import replace

    extra = rig.cameras[0]
    third = replace(extra, name="third", translation_m=extra.translation_m + np.array([0.4, 0.0, 0.0]))
    wide = CameraRig((*rig.cameras, third))
    points = body(5)
    matcher = StereoMatcher(wide)
    blobs = seen(wide, points, 0.1)
    blobs[2] = blobs[2][::-1].copy()
    matches = matcher.match(blobs, matcher.undistort(blobs), points)
    assert len(matches.points_m) == 12
    np.testing.assert_array_equal(matches.blobs[:, 2], 11 - matches.blobs[:, 0])
    two = StereoMatcher(rig).match(blobs[:2], matcher.undistort(blobs)[:2], points)
    assert np.trace(matches.covariances_m2[0]) < np.trace(two.covariances_m2[0])


def test_markers_are_matched_among_a_thousand_dim_reflections(rig):
    rng = np.random.default_rng(3)
    points = body()
    blobs = []
    for camera, rows in zip(rig.cameras, seen(rig, points, 0.0), strict=True):
        ghosts = np.column_stack(
            (
                rng.uniform(0, camera.image_size, (1000, 2)),
                np.full(1000, 4.0),
                rng.uniform(10, 60, 1000),
                np.zeros(1000),
            )
        )
        blobs.append(np.concatenate((ghosts, rows)).astype(np.float32))
    matcher = StereoMatcher(rig)
    found = matcher.match(blobs, matcher.undistort(blobs), points)
    for camera in range(2):  # the cost grows with the square of those that may be matched
        assert len(found.blobs) <= 150
        assert np.isin(1000 + np.arange(12), found.blobs[:, camera]).sum() >= 10
