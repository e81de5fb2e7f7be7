"""From images of two and three cameras to a person's labelled points."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from filmed_people import OTHERS, POINTS, keypoints, moments, networks, picture
from perfanim.core.errors import CaptureError
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.people.people_pipeline import APART, PeoplePipeline, PersonLocator
from perfanim.core.vision.pipeline import check_images
from perfanim.core.vision.sources.image_set import ImageSet

COUNT = 40


@pytest.fixture(scope="module")
def points_m(truth):
    return keypoints(truth)[:COUNT]


def frames(rig, nets, count=COUNT):
    pipeline = PeoplePipeline(rig, nets)
    return [pipeline.process(images) for images in moments(rig, count)]


def test_points_are_labelled_and_where_they_are(points_m):
    rig = default_rig()
    for frame, row in zip(frames(rig, networks(rig, points_m)), points_m, strict=True):
        assert frame.labels.tolist() == list(range(len(POINTS)))
        np.testing.assert_allclose(frame.points_m, row, atol=1e-5)
        assert len(frame.single_labels) == 0 and frame.notes == ()


def test_the_covariance_is_that_of_the_errors(points_m):
    rig = default_rig()
    found = frames(rig, networks(rig, points_m))[5]
    sigma_px = float(found.blobs[0][0, 2])
    noisy = [frames(rig, networks(rig, points_m, sigma_px, seed), 6)[5] for seed in range(60)]
    errors = np.array([frame.points_m - points_m[5] for frame in noisy if len(frame.points_m) == len(POINTS)])
    expected = np.sqrt(np.trace(found.covariances_m2, axis1=1, axis2=2))
    assert np.median(np.sqrt(np.mean(np.sum(errors**2, axis=-1), axis=0)) / expected) == pytest.approx(1.0, abs=0.15)


def test_a_camera_that_shows_nobody_is_told_and_leaves_rays(points_m):
    rig = default_rig()
    nets = networks(rig, points_m)
    nets[1].pixels.clear()
    frame = frames(rig, nets)[-1]
    assert frame.notes == ("the right camera shows nobody",)
    assert len(frame.points_m) == 0
    assert frame.single_labels.tolist() == list(range(len(POINTS))) and set(frame.single_cameras.tolist()) == {0}
    again = rig.cameras[0].project(points_m[-1])
    np.testing.assert_allclose(frame.blobs[0][frame.single_blobs, :2], again, atol=1e-3)


def test_a_frozen_camera_is_left_out_and_only_its_source_tells(points_m):
    rig = default_rig()
    pipeline = PeoplePipeline(rig, networks(rig, points_m))
    pipeline.process(moments(rig, 1)[0])
    frozen = replace(moments(rig, 2)[1], usable=(True, False), notes=("the right camera froze",))
    frame = pipeline.process(frozen)
    assert frame.notes == ("the right camera froze",)
    assert [len(rows) for rows in frame.detected] == [len(POINTS), 0]
    assert np.isnan(frame.camera_times_s[1]) and len(frame.points_m) == 0
    assert set(frame.single_cameras.tolist()) == {0}


def test_cameras_that_see_different_people_are_told(points_m):
    rig = default_rig()
    nets = networks(rig, points_m)
    for pixels in nets[1].pixels.values():
        pixels[:, 1] += 60.0
    assert {frame.notes for frame in frames(rig, nets, 5)} == {(APART,)}


def test_cameras_are_looked_at_beside_each_other_with_the_same_result(points_m):
    rig = default_rig(3)
    one_by_one = frames(rig, networks(rig, points_m, 2.0), 5)
    with ThreadPoolExecutor(2) as others:
        pipeline = PeoplePipeline(rig, networks(rig, points_m, 2.0), others=others)
        for frame, images in zip(one_by_one, moments(rig, 5), strict=True):
            np.testing.assert_array_equal(pipeline.process(images).points_m, frame.points_m)


def test_exchanged_legs_of_one_camera_are_put_right(points_m):
    rig = default_rig()
    nets = networks(rig, points_m)
    legs = [i for i, marker in enumerate(POINTS.markers) if marker.joint[1:] in ("femur", "tibia", "foot", "toes")]
    for n in range(20, 30):
        nets[1].pixels[10 * n + 1][legs] = nets[1].pixels[10 * n + 1][OTHERS[legs]]
    for frame, row in zip(frames(rig, nets), points_m, strict=True):
        np.testing.assert_allclose(frame.points_m, row, atol=1e-5)


def test_rays_that_do_not_meet_are_left_out(points_m):
    rig = default_rig()
    nets = networks(rig, points_m)
    wrist = POINTS.names.index("left_wrist")
    nets[0].pixels[10 * 30][wrist, 1] += 200.0
    found = frames(rig, nets)
    assert wrist not in found[30].labels
    assert wrist in found[29].labels and wrist in found[31].labels


def test_one_wrong_camera_of_three_hardly_matters(points_m):
    rig = default_rig(3)
    nets = networks(rig, points_m)
    for pixels in nets[1].pixels.values():
        pixels[POINTS.names.index("left_wrist")] += 150.0
    frame = frames(rig, nets)[10]
    row = frame.labels.tolist().index(POINTS.names.index("left_wrist"))
    assert np.linalg.norm(frame.points_m[row] - points_m[10][frame.labels[row]]) < 0.02


def test_points_of_a_frame_are_located_again_from_its_pictures(points_m):
    rig = default_rig()
    found = frames(rig, networks(rig, points_m, 2.0))
    locator = PersonLocator(rig, POINTS)
    for frame in found:
        np.testing.assert_array_equal(locator.locate(frame).points_m, frame.points_m)


def test_images_of_another_size_are_refused(points_m):
    rig = default_rig()
    images = moments(rig, 1)[0]
    small = ImageSet(0, images.times_s, tuple(image[:100] for image in images.images))
    with pytest.raises(CaptureError, match="images are 640x100, but the calibration is for"):
        PeoplePipeline(rig, networks(rig, points_m)).process(small)


def test_videos_of_1080_lines_may_be_calibrated_with_their_padding():
    rig = default_rig()
    tall = CameraRig(tuple(replace(camera, image_size=(1088, 1920)) for camera in rig.cameras))
    for size, fits in (((1080, 1920), True), ((1088, 1920), True), ((1072, 1920), False)):
        images = ImageSet(0, (0.0, 0.0), (picture(0, *size), picture(1, *size)))
        if fits:
            check_images(tall, images)
        else:
            with pytest.raises(CaptureError, match="images are 1072x1920, but the calibration is for 1088x1920"):
                check_images(tall, images)


def test_a_whole_take_is_decided_with_later_moments(points_m):
    rig = default_rig()
    nets = networks(rig, points_m, 2.0)
    legs = [i for i, marker in enumerate(POINTS.markers) if marker.joint[1:] in ("femur", "tibia", "foot", "toes")]
    for n in range(3):  # at the start both cameras exchange the legs: no past tells
        for c in range(2):
            nets[c].pixels[10 * n + c][legs] = nets[c].pixels[10 * n + c][OTHERS[legs]]
    live = frames(rig, nets)
    for n, frame in enumerate(PersonLocator(rig, POINTS).locate_all(live)):
        found = np.full((len(POINTS), 3), np.nan)
        found[frame.labels] = frame.points_m
        own, other = (
            np.nansum(np.linalg.norm(found - row, axis=1)[legs]) for row in (points_m[n], points_m[n][OTHERS])
        )
        assert own < other, n
    assert np.linalg.norm(live[0].points_m[legs[0]] - points_m[0][legs[0]]) > 0.05  # as it looked then
