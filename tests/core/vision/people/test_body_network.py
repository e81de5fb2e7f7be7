"""BlazePose's file, and what it finds in a real picture."""

import cv2
import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.vision.people.body_network import BlazePose, Crop
from perfanim.core.vision.people.network_file import NETWORK_FILE, body_network_file
from perfanim.core.vision.people.person_follower import PersonFollower


@pytest.fixture(scope="module")
def network():
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    return BlazePose(body_network_file())


@pytest.fixture(scope="module")
def picture(shared_dir):
    return cv2.VideoCapture(str(shared_dir / "people" / "walk-on-beam" / "cam01.mp4")).read()[1]


def test_a_missing_network_is_told(tmp_path):
    with pytest.raises(CaptureError, match="there is no body network; get the body network first"):
        BlazePose(tmp_path / NETWORK_FILE)


@pytest.mark.parametrize("content", [b"", b"TFL3" * 100, bytes(range(256)) * 40])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / NETWORK_FILE).write_bytes(content)
    with pytest.raises(CaptureError, match=f"is damaged, or not the {NETWORK_FILE} that this version knows"):
        BlazePose(tmp_path / NETWORK_FILE)


def test_the_person_is_found_upright_in_a_real_picture(network, picture):
    found = PersonFollower(network, 1000).step(picture)
    names = load_marker_set(BlazePose.marker_set).names
    at = {name: found.pixels[names.index(name)] for name in ("nose", "left_hip", "right_hip", "left_ankle")}
    assert found.score > 0.9
    assert at["nose"][1] < at["left_hip"][1] < at["left_ankle"][1]
    assert 300 < at["nose"][0] < 700 and at["left_hip"][0] > at["right_hip"][0]  # he faces the camera


def test_a_turned_picture_gives_the_same_points(network, picture):
    upright = PersonFollower(network, 1000).step(picture)
    height = picture.shape[0]
    turned = cv2.rotate(picture, cv2.ROTATE_90_CLOCKWISE)
    crop = upright.crop
    lying = network.find(turned, Crop(height - 1 - crop.y_px, crop.x_px, crop.side_px, crop.turn_rad + np.pi / 2))
    back = np.stack((lying.pixels[:, 1], height - 1 - lying.pixels[:, 0]), axis=1)
    again = network.find(picture, crop)
    assert np.median(np.linalg.norm(back - again.pixels, axis=1)) < 0.01 * crop.side_px


def test_an_empty_picture_shows_nobody(network):
    assert network.find(np.full((480, 640, 3), 90, dtype=np.uint8), Crop(320, 240, 480)).score < 0.5
