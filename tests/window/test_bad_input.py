"""Bad input in a real window: a message in the panel, and Blender still usable."""

import time
from pathlib import Path

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


def refusal(window: BlenderWindow) -> str:
    """Return why Start Capture cannot be clicked."""
    return str(window.order("call", operator="start_capture").get("error", ""))


def test_files_and_bones_that_are_missing(desktop: Desktop, opened: BlenderWindow, tmp_path: Path) -> None:
    window = opened
    name = window.order("bare_armature")["name"]
    window.order("set", values={"armature": name})
    message = refusal(window)
    assert "lacks the bones" in message
    assert "root" in message
    time.sleep(1.0)
    desktop.screenshot("bad-1-bones")
    window.order("set", values={"armature": ""})

    empty = tmp_path / "empty.perfdb"
    empty.write_bytes(b"")
    window.order("set", values={"database": str(empty)})
    assert "not a motion database" in refusal(window)
    window.order("set", values={"database": ""})

    missing = str(tmp_path / "no.mp4")
    window.order("set", values={"source": "VIDEOS", "left_video": missing, "right_video": missing})
    message = refusal(window)
    assert "not found" in message
    assert "no.mp4" in message
    time.sleep(1.0)
    desktop.screenshot("bad-2-video")
    still_usable(window)


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
