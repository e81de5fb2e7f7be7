"""Which cameras are plugged in."""

from typing import ClassVar

import cv2
import numpy as np
import pytest
from perfanim.core.vision.sources import device_names
from perfanim.core.vision.sources.camera_source import FoundCamera, find_cameras

SIZES = {0: (640, 480), 2: None, 3: (1280, 720)}  # device 1 is none


class PlayedDevice:
    """A device as OpenCV opens it; its first read gives nothing, as those of many cameras."""

    opened: ClassVar[list["PlayedDevice"]] = []

    def __init__(self, device: int) -> None:
        self.device, self.reads, self.released = device, 0, False
        self.opened.append(self)

    def isOpened(self) -> bool:  # noqa: N802
        return self.device in SIZES

    def read(self) -> tuple[bool, np.ndarray | None]:
        self.reads += 1
        size = SIZES[self.device]
        if size is None or self.reads == 1:
            return False, None
        return True, np.zeros((size[1], size[0], 3), np.uint8)

    def release(self) -> None:
        self.released = True


def test_found_cameras_have_their_image_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PlayedDevice, "opened", [])
    monkeypatch.setattr(cv2, "VideoCapture", PlayedDevice)
    monkeypatch.setattr(device_names.sys, "platform", "win32")
    assert find_cameras() == [FoundCamera(0, (640, 480)), FoundCamera(2, None), FoundCamera(3, (1280, 720))]
    assert all(device.released for device in PlayedDevice.opened)
