"""A newcomer's way through the sidebar: cameras, performer, capture; simulated ones stand in for real ones."""

import time
from typing import Any

import cv2
import numpy as np
from desktop import DRAWING_S, BlenderWindow, Desktop

HEADER_PX = 28  # height of a closed panel
HEADER_TOP_PX = 14
CORNER_COLOUR = np.array((60, 220, 255))  # blue, green, red
LEAST_MARKED_PX = 100  # of two boards of 54 corners


def click_through(window: BlenderWindow, operator: str, panel: str) -> str:
    """Press an operator's button, wait for the end of its work, and return what its panel says."""
    assert "result" in window.order("call", operator=operator)

    def ended(state: dict[str, Any]) -> bool:
        return state["capture"]["activity"] is None and bool(state["capture"]["messages"].get(panel))

    return str(window.wait(ended, f"end of {operator}")["capture"]["messages"][panel])


def wait_for_corners(desktop: Desktop, window: BlenderWindow, picture_name: str) -> None:
    """Take pictures of the screen until the viewport shows a board with its corners marked, as the preview does."""
    limit = time.monotonic() + DRAWING_S
    while True:
        image = cv2.imread(str(desktop.screenshot(picture_name)))
        assert image is not None
        region = window.state()["regions"]["WINDOW"]
        left, top = window.from_top(region, 0, 0)
        pixels = image[int(top) : int(top) + region[3], int(left) : int(left) + region[2]].astype(int)
        marked = int((np.abs(pixels - CORNER_COLOUR).max(axis=2) < 40).sum())
        if marked > LEAST_MARKED_PX:
            return
        assert time.monotonic() < limit, f"{marked} pixels of the corners' colour"


def toggle_panel(desktop: Desktop, window: BlenderWindow, number: int) -> None:
    """Click on a panel's header to open or close it, all before it being closed."""
    region = window.state()["regions"]["UI"]
    desktop.click(*window.from_top(region, 60, HEADER_TOP_PX + number * HEADER_PX))
    time.sleep(1.0)


def test_calibrating_and_capturing_without_leaving_the_sidebar(desktop: Desktop, window: BlenderWindow) -> None:
    window.open_tab("Perfanim")
    window.order("set", values={"practise": True})
    toggle_panel(desktop, window, 1)
    refused = window.order("call", operator="start_capture")
    assert "calibrate the cameras" in refused["error"]
    assert "result" in window.order("call", operator="calibrate_board")
    window.wait(lambda s: s["preview"]["shown"] and s["capture"]["heading"] > "0 views", "a view")
    wait_for_corners(desktop, window, "newcomer-1-board")
    ended = window.wait(lambda s: s["capture"]["activity"] is None, "end of the calibration")
    assert ended["capture"]["messages"]["cameras"].startswith("good")
    assert ended["preview"] == {"shown": False, "image": False}
    assert click_through(window, "set_floor", "cameras").startswith("floor set at the board")
    time.sleep(1.0)
    desktop.screenshot("newcomer-2-cameras")
    toggle_panel(desktop, window, 1)
    toggle_panel(desktop, window, 3)
    assert click_through(window, "calibrate_performer", "subject").partition(": ")[2].startswith("residual")
    time.sleep(1.0)
    desktop.screenshot("newcomer-3-ready")
    window.order("set", values={"capture_preview": True})
    assert "result" in window.order("call", operator="start_capture")
    window.wait(lambda s: s["capture"].get("statistics", {}).get("received", 0) > 60, "poses")
    window.wait(lambda s: s["preview"]["shown"], "what the cameras see")
    time.sleep(1.0)
    desktop.screenshot("newcomer-4-live")
    assert "result" in window.order("call", operator="stop_capture")
    state = window.wait(lambda s: s["capture"]["activity"] is None, "end of the capture")
    assert state["preview"] == {"shown": False, "image": False}
    (action,) = state["actions"].values()
    assert action["keys_min"] == action["keys_max"] == round(action["last"]) >= 24  # a second of the scene
    # what was recorded is of the T pose that opens the performance, seen by calibrated cameras
    confidence = window.order("last_run")["confidence"]
    assert sorted(confidence)[len(confidence) // 2] > 0.5
