"""What is set before anybody sets it: sensible for a simulated performer, webcams and fast cameras."""

from dataclasses import asdict
from typing import Any

import cv2
import numpy as np
import pytest
from perfanim.core.worker.open_source import open_source


class Camera:
    """A camera as OpenCV opens it, with a rate of its own unless another is asked of it."""

    def __init__(self, rate: float) -> None:
        self.rate = rate

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return True

    def set(self, setting: int, value: float) -> bool:
        self.rate = value if setting == cv2.CAP_PROP_FPS else self.rate
        return True

    def get(self, setting: int) -> float:
        return self.rate if setting == cv2.CAP_PROP_FPS else 0.0

    def read(self) -> tuple[bool, Any]:
        return True, np.zeros((480, 640, 3), np.uint8)

    def getBackendName(self) -> str:  # noqa: N802 - OpenCV's name
        return "V4L2"

    def release(self) -> None:
        pass


@pytest.mark.parametrize("rate", [25.0, 30.0, 120.0])
def test_cameras_give_the_rate_that_they_have(part: Any, chosen: Any, rate: float, monkeypatch: Any) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", lambda _device: Camera(rate))
    chosen.source = "CAMERAS"
    for wanted, given in ((chosen.camera_fps, rate), (60.0, 60.0)):
        chosen.camera_fps = wanted
        source = open_source(asdict(part("capture.capture_request").source(chosen)))
        assert source.fps == given
        source.close()


def test_a_camera_that_keeps_its_rate_to_itself_counts_as_a_webcam(part: Any, chosen: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", lambda _device: Camera(0.0))
    chosen.source = "CAMERAS"
    assert open_source(asdict(part("capture.capture_request").source(chosen))).fps == 30.0


def test_pictures_in_folders_are_those_of_webcams(part: Any, chosen: Any, tmp_path: Any) -> None:
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for number in range(3):
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), np.zeros((48, 64), np.uint8))
    chosen.source, chosen.left_folder, chosen.right_folder = "IMAGES", str(tmp_path / "left"), str(tmp_path / "right")
    assert open_source(asdict(part("capture.capture_request").source(chosen))).fps == 30.0


def test_the_simulated_studio_has_60_images_a_second(part: Any, chosen: Any) -> None:
    assert open_source(asdict(part("capture.capture_request").source(chosen))).fps == 60.0


def test_a_newcomer_sees_the_markers_and_keeps_the_feet(chosen: Any) -> None:
    assert chosen.overlay == {"MARKERS", "GHOST"}
    assert chosen.feet == "auto"
    assert chosen.record_length_s == chosen.smoothing_ms == 0.0
