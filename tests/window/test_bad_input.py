"""Bad input in a real window: a message in the panel, and Blender still usable."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from desktop import BlenderWindow, Desktop


@pytest.fixture
def opened(desktop: Desktop, window: BlenderWindow) -> BlenderWindow:
    window.open_tab("Perfanim")
    return window


def still_usable(window: BlenderWindow) -> None:
    """The defaults capture at once, so nothing was left behind."""
    window.order(
        "set", values={"source": "SIMULATED", "armature": "", "database": "", "calibration": "", "subject": ""}
    )
    assert "result" in window.order("call", operator="start_capture")
    window.wait(lambda s: s["capture"].get("phase") == "RUNNING", "capture that runs")
    assert "result" in window.order("call", operator="stop_capture")
    window.wait(lambda s: s["capture"]["activity"] is None, "end of the capture")


def test_a_camera_that_does_not_open(desktop: Desktop, opened: BlenderWindow, calibration: Path, subject: Path) -> None:
    window = opened
    values = {"source": "CAMERAS", "left_device": 61, "right_device": 62}
    window.order("set", values={**values, "calibration": str(calibration), "subject": str(subject)})
    assert "result" in window.order("call", operator="start_capture")
    state = window.wait(lambda s: s["capture"]["activity"] is None and s["capture"]["messages"].get("capture"), "end")
    assert "61" in state["capture"]["messages"]["capture"]
    assert not state["actions"]
    assert not state["armature"]
    assert not state["capture"]["timer"]
    desktop.screenshot("bad-3-camera")
    still_usable(window)


def message_after(window: BlenderWindow, operator: str, panel: str) -> str:
    """Click an operator's button and return what its panel says when it has ended."""
    assert "result" in window.order("call", operator=operator)

    def ended(state: dict[str, Any]) -> bool:
        return state["capture"]["activity"] is None and bool(state["capture"]["messages"].get(panel))

    state = window.wait(ended, "end")
    assert not state["capture"]["timer"]
    assert not state["actions"]
    return str(state["capture"]["messages"][panel])


def video(path: Path, frames: int) -> str:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 60.0, (640, 480))
    for _ in range(frames):
        writer.write(np.zeros((480, 640, 3), np.uint8))
    writer.release()
    return str(path)


def test_videos_that_cannot_be_used(
    desktop: Desktop, opened: BlenderWindow, calibration: Path, subject: Path, tmp_path: Path
) -> None:
    window = opened
    (tmp_path / "text.mp4").write_text("no video")
    long, short = video(tmp_path / "long.avi", 60), video(tmp_path / "short.avi", 40)
    common = {"source": "VIDEOS", "calibration": str(calibration), "subject": str(subject)}
    window.order("set", values={**common, "left_video": long, "right_video": str(tmp_path / "text.mp4")})
    message = message_after(window, "start_capture", "capture")
    assert "text.mp4" in message
    assert "cannot be opened as a video" in message
    desktop.screenshot("bad-4-unreadable")
    window.order("set", values={"right_video": short})
    message = message_after(window, "start_capture", "capture")
    assert "different lengths: long.avi 60 frames, short.avi 40 frames" in message
    desktop.screenshot("bad-5-lengths")
    still_usable(window)
