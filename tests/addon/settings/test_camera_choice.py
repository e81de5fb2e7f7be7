"""Cameras are chosen by name, and by a thumbnail once somebody has looked."""

from typing import Any

import bpy
import numpy as np
import pytest


@pytest.fixture
def choice(part: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    choice = part("settings.camera_choice")
    monkeypatch.setattr(choice, "device_numbers", lambda: [0, 1, 2, 3])
    monkeypatch.setattr(choice, "device_name", lambda device: f"Webcam {device}")
    return choice


@pytest.fixture
def chosen(addon: object) -> Any:
    return bpy.context.scene.perfanim


def names(choice: Any, chosen: Any, setting: str, optional: bool = False) -> list[str]:
    return [name for _, name, *_ in choice.items_of(setting, optional)(chosen, None)]


def test_a_name_stands_for_its_number(choice: Any, chosen: Any) -> None:
    assert (chosen.left_camera, chosen.right_camera) == ("0", "1")
    chosen.left_camera, chosen.right_camera = "2", "NONE"
    assert (chosen.left_device, chosen.right_device) == (2, -1)
    chosen.right_device = 3
    assert chosen.right_camera == "3"
    assert names(choice, chosen, "right_device", True) == ["Webcam 0", "Webcam 1", "Webcam 2", "Webcam 3", "None"]


def test_a_camera_that_is_not_plugged_in_stays_chosen(choice: Any, chosen: Any) -> None:
    chosen.left_device = 7
    assert chosen.left_camera == "7"
    assert names(choice, chosen, "left_device")[-1] == "Webcam 7"


def test_the_cameras_that_were_seen_are_offered_with_their_pictures(choice: Any, chosen: Any) -> None:
    assert not choice.has_thumbnails()
    picture = np.zeros((240, 640, 3), np.uint8)
    picture[:, 320:] = (255, 0, 0)
    for _ in range(2):  # looked again
        choice.keep_pictures([0, 3], picture)
    assert choice.has_thumbnails()
    assert names(choice, chosen, "left_device") == ["Webcam 0", "Webcam 3"]
    thumbnail = choice._seen.thumbnails["3"]
    assert tuple(thumbnail.image_size) == (160, 120)
    np.testing.assert_allclose(thumbnail.image_pixels_float[:4], [1.0, 0.0, 0.0, 1.0])
    choice.unregister()
    assert not choice.has_thumbnails()
