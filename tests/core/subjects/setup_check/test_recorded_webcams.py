"""The check on webcams that others recorded in the dark: their second sequence has no fault but those put in."""

from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pytest
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.subjects.setup_check.find_faults import check_setup
from perfanim.core.subjects.setup_check.finding import Fault
from perfanim.core.vision.calibration.board_points import load_board_points
from perfanim.core.vision.calibration.calibrate import calibrate_from_points
from perfanim.core.vision.detection.background import background_from_take
from perfanim.core.vision.sources.image_file_source import ImageFileSource
from perfanim.core.vision.sources.image_set import ImageSet

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def rig(shared_dir):
    return calibrate_from_points(*load_board_points(shared_dir / "two-webcams" / "stereo_calibration.json")).rig


@pytest.fixture(scope="module")
def moments_of(shared_dir):
    @cache
    def read(sequence):
        patterns = [shared_dir / "two-webcams" / f"sequence{sequence}" / f"*_{side}.jpg" for side in (1, 2)]
        return [ImageSet(m.number, m.times_s, m.images) for m in islice(ImageFileSource(patterns, 30.0), 40)]

    return read


def faults(rig, moments):
    backgrounds = [background_from_take(column[::4]) for column in zip(*(m.images for m in moments), strict=True)]
    return [finding.fault for finding in check_setup(rig, backgrounds, moments, load_marker_set("two-webcams"), 1.6)]


def test_no_fault(rig, moments_of):
    assert faults(rig, moments_of(2)) == []


def test_exchanged_pictures(rig, moments_of):
    moments = [replace(m, images=m.images[::-1], times_s=m.times_s[::-1]) for m in moments_of(2)]
    assert faults(rig, moments) == [Fault.EXCHANGED]


def test_a_camera_turned_by_two_degrees(rig, moments_of):
    left, right = rig.cameras
    rotation = rot.to_matrix(rot.from_rotation_vector(np.radians([2.0, 0.0, 0.0]))) @ right.rotation
    turned = replace(right, rotation=rotation, translation_m=-rotation @ right.centre_m)
    assert faults(replace(rig, cameras=(left, turned)), moments_of(2)) == [Fault.BUMPED]


def test_the_dim_right_camera(rig, moments_of):
    assert faults(rig, moments_of(3)) == [Fault.DARK]
