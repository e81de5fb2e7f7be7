"""Faults in how two cameras see a person without markers, with points as a network would find them."""

from dataclasses import replace

import numpy as np
import pytest
from filmed_people import POINTS, keypoints, moments, networks
from perfanim.core.errors import CaptureError
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.subjects.setup_check.finding import PersonFault
from perfanim.core.subjects.setup_check.person_faults import check_others, check_person
from perfanim.core.vision.people.people_pipeline import PeoplePipeline

COUNT = 20
FEET = [index for index, marker in enumerate(POINTS.markers) if marker.joint[1:] in ("foot", "toes")]


@pytest.fixture(scope="module")
def points_m(truth):
    return keypoints(truth)[:COUNT]


@pytest.fixture
def rig():
    """Two cameras 90 degrees apart, which a person between them and 3 m away sees at the same height."""
    return _rig(90.0)


def _rig(angle_deg, distance_m=3.5):
    cameras = []
    for name, camera in zip("lr", default_rig().cameras, strict=True):
        half = np.radians(0.5 * angle_deg) * (-1.0 if name == "l" else 1.0)
        centre_m = np.array([distance_m * np.sin(half), 1.0, distance_m * np.cos(half)])
        forward = np.array([-np.sin(half), 0.0, -np.cos(half)])
        right = np.cross(forward, [0.0, 1.0, 0.0])
        rotation = np.array([right, [0.0, -1.0, 0.0], forward])
        cameras.append(replace(camera, name=name, rotation=rotation, translation_m=-rotation @ centre_m))
    return CameraRig(tuple(cameras))


def found(rig, nets, level=120, count=COUNT):
    pipeline = PeoplePipeline(rig, nets)

    def looked_at():
        for images in moments(rig, count):
            frame = pipeline.process(images)
            bright = tuple(np.maximum(image, level).astype(np.uint8) for image in images.images)
            yield replace(images, images=bright), frame

    return check_person(rig, POINTS, looked_at())


def faults(findings):
    return [(finding.fault, finding.where) for finding in findings]


def middle(points_m):
    """Return the points (F, K, 3) of a person who stays between the cameras."""
    centre_m = points_m.mean(axis=(0, 1)) * (1.0, 0.0, 1.0)
    return points_m - centre_m


def test_a_person_whom_both_cameras_see_has_no_fault(rig, points_m):
    assert found(rig, networks(rig, middle(points_m))) == []


def test_a_camera_that_shows_nobody_is_named(rig, points_m):
    nets = networks(rig, middle(points_m))
    nets[1].pixels.clear()
    assert faults(found(rig, nets)) == [(PersonFault.NOBODY, "the right camera")]


def test_feet_below_the_picture_are_told(rig, points_m):
    nets = networks(rig, middle(points_m))
    for pixels in nets[0].pixels.values():
        pixels[FEET, 1] = 490.0
    (finding,) = found(rig, nets)
    assert (finding.fault, finding.where) == (PersonFault.CUT_OFF, "the left camera")
    assert finding.text.startswith("the left camera does not see your feet in 100 % of the pictures: step back")


def test_a_dark_picture_is_told(rig, points_m):
    assert faults(found(rig, networks(rig, middle(points_m)), level=20)) == [
        (PersonFault.DARK, "the left camera"),
        (PersonFault.DARK, "the right camera"),
    ]


def test_a_person_far_away_is_told(points_m):
    rig = _rig(90.0, 9.0)
    assert {finding.fault for finding in found(rig, networks(rig, middle(points_m)))} == {PersonFault.SMALL}


@pytest.mark.parametrize(("angle_deg", "is_fault"), [(20.0, True), (60.0, False), (130.0, False), (170.0, True)])
def test_cameras_that_see_the_person_from_one_side_are_told(points_m, angle_deg, is_fault):
    rig = _rig(angle_deg)
    findings = found(rig, networks(rig, middle(points_m)))
    assert faults(findings) == ([(PersonFault.ANGLE, "")] if is_fault else [])
    assert not is_fault or f"{angle_deg:.0f} degrees apart" in findings[0].text


def test_cameras_that_see_different_places_are_told(points_m):
    rig = _rig(90.0, 4.5)
    moved = replace(rig.cameras[1], translation_m=rig.cameras[1].translation_m + np.array((0.0, 0.4, 0.0)))
    seen = CameraRig((rig.cameras[0], moved))
    assert faults(found(rig, networks(seen, middle(points_m)))) == [(PersonFault.APART, "")]


def test_too_few_pictures_are_refused(rig, points_m):
    with pytest.raises(CaptureError, match="3 moments are too few for a check"):
        found(rig, networks(rig, middle(points_m)), count=3)


def test_somebody_else_is_told_if_two_pictures_show_them(rig):
    once, twice = np.array([[50.0, 60.0]]), np.array([[500.0, 200.0], [504.0, 202.0]])
    assert check_others(rig, [once, np.empty((0, 2))]) == []
    (finding,) = check_others(rig, [once, twice])
    assert (finding.fault, finding.where) == (PersonFault.OTHERS, "the right camera")
    assert finding.text.startswith("the right camera shows somebody else: ask them to leave the picture")
    assert finding.places == ((1, 502.0, 201.0),)
