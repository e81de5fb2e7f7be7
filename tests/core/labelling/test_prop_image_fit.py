"""A prop compared with the images: which blobs are its own, and the pose that explains them."""

import numpy as np
import pytest
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera
from perfanim.core.labelling.prop_image_fit import Placed, PropImages
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.prop import load_prop
from perfanim.core.simulate.studio.studio_rig import default_rig

PROP = load_prop("sword")
CAMERAS = default_rig().cameras
CENTRE_PX = 0.3  # errors of this size count half
NEAR = 1e-5  # an exact fit stops at steps below this; metres and radians


def placed(turn=(0.2, 0.4, 0.3), shift=(0.05, 1.2, 0.3)):
    return Placed(rot.to_matrix(rot.from_rotation_vector(np.array(turn))), np.array(shift), 0.5)


def frame_of(pixels):
    """The frame of pixels (n, 2) of each camera."""
    blobs = [np.tile(np.array([0.0, 0.0, 4.0, 200.0, 0.0], dtype=np.float32), (len(seen), 1)) for seen in pixels]
    for rows, seen in zip(blobs, pixels, strict=True):
        rows[:, :2] = seen
    return MarkerFrame(7, 0.5, blobs=tuple(blobs))


def shown(at, noise_px=0.0, cameras=CAMERAS):
    """Pixels (n, 2) of the markers in each image."""
    generator = np.random.default_rng(1)
    pixels = [camera.project(at.markers(PROP)) for camera in cameras]
    return [seen + generator.normal(scale=noise_px, size=seen.shape) for seen in pixels]


def images_of(pixels, cameras=CAMERAS):
    return PropImages(cameras, frame_of(pixels), PROP)


def own_blobs():
    return np.tile(np.arange(len(PROP.names))[:, None], (1, len(CAMERAS)))


def off(one, other):
    """How far two places are from each other: metres and radians."""
    turns = [rot.from_matrix(place.turn) for place in (one, other)]
    return max(np.linalg.norm(one.shift - other.shift), rot.angle_between(*turns))


def test_nearest_blobs_in_any_order():
    at, generator = placed(), np.random.default_rng(2)
    pixels, expected = [], np.full((5, 2), -1)
    for index, (seen, hidden) in enumerate(zip(shown(at), ([1], [0, 4]), strict=True)):
        kept = np.setdiff1d(np.arange(5), hidden)
        order = generator.permutation(kept)
        pixels.append(np.concatenate((seen[order], [[5.0, 5.0]])))
        expected[order, index] = np.arange(len(kept))
    np.testing.assert_array_equal(images_of(pixels).nearest(at, 3.0), expected)


def test_nearest_blobs_are_mutual_and_within_limits():
    at = placed()
    pixels = [seen.copy() for seen in shown(at)]
    pixels[0][2] += [3.0, 0.0]
    pixels[1][3] += [0.0, 3.0]
    images, everywhere = images_of(pixels), own_blobs()
    np.testing.assert_array_equal(images.nearest(at, 3.1), everywhere)
    one_missing = everywhere.copy()
    one_missing[2, 0] = -1
    np.testing.assert_array_equal(images.nearest(at, np.array([[2.9], [3.1]])), one_missing)
    # however far one may look: what lies nearer to another marker is that one's
    alone = images_of([pixels[0][[1]], pixels[1][[3]]]).nearest(at, 1e4)
    np.testing.assert_array_equal(alone, [[-1, -1], [0, -1], [-1, -1], [-1, 0], [-1, -1]])


def test_no_blobs_behind_the_camera_or_in_an_empty_image():
    behind = placed(shift=(0.0, 1.0, 9.0))
    assert np.all(images_of(shown(placed())).nearest(behind, 1e4) == -1)
    found = images_of([shown(placed())[0], np.empty((0, 2))]).nearest(placed(), 1e4)
    np.testing.assert_array_equal(found, np.column_stack((np.arange(5), np.full(5, -1))))


def test_distance_in_pixels_at_the_prop():
    matrix = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    cameras = [
        Camera(f"{z}", (640, 480), matrix, rotation=WORLD_FROM_CAMERA, translation_m=np.array([0.0, 1.0, z]))
        for z in (3.0, 4.5)
    ]
    at = placed()
    middle = at.markers(PROP).mean(axis=0)
    aside = middle + np.array([0.03, 0.0, 0.0])
    expected = [np.linalg.norm(camera.project(aside) - camera.project(middle)) for camera in cameras]
    images = images_of(shown(at, cameras=cameras), cameras)
    np.testing.assert_allclose(images.pixels_of(at, 0.03), np.array(expected)[:, None], rtol=1e-9)
    # a prop at the lens is as large as one 10 cm before it
    np.testing.assert_allclose(images.pixels_of(placed(shift=(0.0, 1.0, 9.0)), 0.03), 0.03 * 600.0 / 0.1)


@pytest.mark.parametrize("shift", [(0.03, -0.02, 0.04), (-0.02, 0.03, -0.05)])
def test_fit_converges_with_both_cameras_or_one(shift):
    truth = placed()
    start = Placed(rot.to_matrix(rot.from_rotation_vector(np.array([0.06, -0.05, 0.04]))) @ truth.turn,
                   truth.shift + shift, 0.25)  # fmt: skip
    blobs = own_blobs()
    blobs[[0, 2], 0] = -1
    blobs[[1], 1] = -1
    found, errors = images_of(shown(truth)).fit(start, blobs)
    assert off(found, truth) < NEAR
    assert found.time_s == start.time_s
    np.testing.assert_array_equal(np.isfinite(errors), blobs >= 0)
    assert errors[blobs >= 0].max() < 0.01


def cauchy_cost(at, pixels):
    """Minus the logarithm of the likelihood of pixels, with the heavy tails of Cauchy's distribution."""
    distances = [np.linalg.norm(c.undistort(c.project(at.markers(PROP))) - c.undistort(seen), axis=1) * c.focal_px
                 for c, seen in zip(CAMERAS, pixels, strict=True)]  # fmt: skip
    return np.log1p((np.concatenate(distances) / CENTRE_PX) ** 2).sum()


def test_fit_is_robust_and_a_minimum():
    truth = placed()
    pixels = shown(truth, noise_px=0.1)
    pixels[0][3] += [9.0, -12.0]
    start = Placed(truth.turn, truth.shift + np.array([0.003, -0.003, 0.004]), 0.5)
    found, errors = images_of(pixels).fit(start, own_blobs())
    # 0.1 pixel at 3.3 m and 540 pixels is 0.6 mm across, and 1.1 mm in depth with cameras 1.8 m apart; three of these
    assert off(found, truth) < 0.005
    assert errors[3, 0] == pytest.approx(15.0, abs=1.0)
    assert np.delete(errors.ravel(), 6).max() < 0.5
    least = cauchy_cost(found, pixels)
    for step in 0.0005 * np.concatenate((np.eye(6), -np.eye(6))):
        turn = rot.to_matrix(rot.from_rotation_vector(step[:3])) @ found.turn
        assert cauchy_cost(Placed(turn, found.shift + step[3:], 0.5), pixels) > least


def test_unobserved_directions_stay():
    """A single blob moves the prop across its ray, and leaves depth and the way it points about alone."""
    truth = placed()
    start = Placed(truth.turn, truth.shift + np.array([0.01, 0.0, 0.0]), 0.5)
    blobs = np.full((5, 2), -1)
    blobs[1, 0] = 1
    pixels = shown(truth)
    found, errors = images_of(pixels).fit(start, blobs)
    assert errors[1, 0] < 0.01
    assert np.isinf(np.delete(errors.ravel(), 2)).all()
    assert off(found, start) < 0.015
    ray = CAMERAS[0].rays(CAMERAS[0].undistort(pixels[0][1]))
    assert abs((found.markers(PROP)[1] - start.markers(PROP)[1]) @ ray) < 0.001


def test_rms_distance_from_rays():
    truth = placed()
    moved = Placed(truth.turn, truth.shift + np.array([0.004, 0.01, -0.006]), 0.5)
    images, blobs = images_of(shown(truth)), own_blobs()
    blobs[[1, 2], 0] = -1
    away = []
    for index, camera in enumerate(CAMERAS):
        seen = blobs[:, index] >= 0
        rays = camera.rays(camera.undistort(camera.project(truth.markers(PROP)[seen])))
        away.append(np.linalg.norm(np.cross(moved.markers(PROP)[seen] - camera.centre_m, rays), axis=1))
    assert images.off_m(moved, blobs) == pytest.approx(np.sqrt(np.mean(np.concatenate(away) ** 2)), rel=1e-3)
    assert images.off_m(truth, blobs) < NEAR
