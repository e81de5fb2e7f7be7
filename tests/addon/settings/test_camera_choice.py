"""Cameras are chosen by name, and by a thumbnail once somebody has looked."""

from typing import Any

import numpy as np
import pytest

BELOW = ("Network Address", "None")  # the rows below the cameras
STREAM = "rtsp://192.168.1.20:554/stream"


@pytest.fixture
def choice(part: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    choice = part("settings.camera_choice")
    monkeypatch.setattr(choice, "device_numbers", lambda: [0, 1, 2, 3])
    monkeypatch.setattr(choice, "device_name", lambda device: f"Webcam {device}")
    return choice


def names(choice: Any, chosen: Any, setting: str, optional: bool = False) -> list[str]:
    return [name for _, name, *_ in choice.items_of(setting, optional)(chosen, None)]


def test_a_name_stands_for_its_number(choice: Any, chosen: Any) -> None:
    assert (chosen.left_camera, chosen.right_camera) == ("0", "1")
    chosen.left_camera, chosen.right_camera = "2", "NONE"
    assert (chosen.left_device, chosen.right_device) == (2, -1)
    chosen.right_device = 3
    assert chosen.right_camera == "3"
    assert names(choice, chosen, "right_device", True) == ["Webcam 0", "Webcam 1", "Webcam 2", "Webcam 3", *BELOW]


def test_a_camera_that_is_not_plugged_in_stays_chosen(choice: Any, chosen: Any) -> None:
    chosen.left_device = 7
    assert chosen.left_camera == "7"
    assert names(choice, chosen, "left_device")[-2:] == ["Webcam 7", BELOW[0]]


def test_the_cameras_that_were_seen_are_offered_with_their_pictures(choice: Any, chosen: Any) -> None:
    assert not choice.has_thumbnails()
    picture = np.zeros((240, 640, 3), np.uint8)
    picture[:, 320:] = (255, 0, 0)
    for _ in range(2):  # looked again
        choice.keep_pictures([0, 3], picture)
    assert choice.has_thumbnails()
    assert names(choice, chosen, "left_device") == ["Webcam 0", "Webcam 3", BELOW[0]]
    thumbnail = choice._seen.thumbnails["3"]
    assert tuple(thumbnail.image_size) == (160, 120)
    np.testing.assert_allclose(thumbnail.image_pixels_float[:4], [1.0, 0.0, 0.0, 1.0])
    choice.unregister()
    assert not choice.has_thumbnails()


@pytest.fixture
def online(choice: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "is_online_allowed", lambda: True)


def status(part: Any, chosen: Any) -> Any:
    return part("settings.readiness").pictures(chosen)


@pytest.mark.usefixtures("online")
def test_a_network_camera_is_asked_for_by_its_address(part: Any, choice: Any, chosen: Any) -> None:
    chosen.source = "CAMERAS"
    chosen.left_camera, chosen.left_address = "NETWORK", f" {STREAM} "
    assert chosen.left_device == choice.NETWORK
    assert chosen.left_camera == "NETWORK"
    assert status(part, chosen).ready
    assert part("capture.capture_request").source(chosen).devices == (STREAM, 1)
    chosen.further_devices = "2, http://192.168.1.21/video"
    assert part("capture.capture_request").source(chosen).devices == (STREAM, 1, 2, "http://192.168.1.21/video")
    chosen.further_devices, chosen.right_camera, chosen.right_address = "", "NETWORK", STREAM
    assert "chosen twice" in status(part, chosen).problem
    chosen.right_camera = "NONE"
    assert part("capture.capture_request").source(chosen).devices == (STREAM,)


@pytest.mark.usefixtures("online")
@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("", "enter the address"),
        ("192.168.1.20", "not the address of a camera"),
        ("http://192.168.1.20/walk.mp4", "not the address of a camera"),
        ("rtsp://[192.168.1.20/stream", "has no host name"),
        ("rtsp:///stream", "has no host name"),
    ],
)
def test_an_address_that_is_none_is_refused_before_a_capture(
    part: Any, chosen: Any, address: str, problem: str
) -> None:
    chosen.source, chosen.right_camera, chosen.right_address = "CAMERAS", "NETWORK", address
    assert problem in status(part, chosen).problem
    assert "right camera" in status(part, chosen).problem
    chosen.right_camera, chosen.right_address = "1", address
    assert status(part, chosen).ready  # of a camera that is plugged in it is not asked for


@pytest.mark.parametrize(("address", "ready"), [(STREAM, False), ("http://127.0.0.1:8080/video", True)])
def test_without_online_access_only_this_computer_is_asked(
    part: Any, choice: Any, chosen: Any, monkeypatch: pytest.MonkeyPatch, address: str, ready: bool
) -> None:
    monkeypatch.setattr(choice, "is_online_allowed", lambda: False)
    chosen.source, chosen.left_camera, chosen.left_address = "CAMERAS", "NETWORK", address
    assert status(part, chosen).ready == ready
    assert ("Allow Online Access" in status(part, chosen).problem) == (not ready)


def test_the_left_camera_is_always_one(chosen: Any) -> None:
    chosen.left_device = -1
    assert chosen.left_device == 0
