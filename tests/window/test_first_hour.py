"""The first hour: a new Blender to a moving character, and the guide through all steps on simulated cameras.

`make window-test MARK=pictures` keeps pictures of it in docs/pictures; otherwise they lie in out/window.
"""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from desktop import DRAWING_S, ROOT, BlenderWindow, Desktop
from sidebar_steps import CAPTURED, GUIDED_S, TESTED_FRAMES, follow_guide, opened, received

PICTURES = ROOT / "docs" / "pictures"
JPEG = [cv2.IMWRITE_JPEG_QUALITY, 88]
KEEPS_PICTURES = "PERFANIM_KEEP_PICTURES" in os.environ
CALM_S = 60.0
CORNER_COLOUR = np.array((60, 220, 255))  # blue, green, red
LEAST_MARKED_PX = 100  # of two boards of 54 corners
OPENING = 60  # frames
NO_PREVIEW = {"shown": False, "image": False}
KEPT_STEPS = {"reflection": "guide-fault", "performer": "guide"}  # steps of the guide with a picture in the documents


@pytest.fixture
def desktop(wrapper: str) -> Iterator[Desktop]:
    """A screen of the size of a small laptop's."""
    desktop = Desktop(wrapper, ROOT / "out" / "window", (1280, 720))
    yield desktop
    desktop.close()


def keep(picture: Path, name: str, part: tuple[slice, slice] = (slice(None), slice(None))) -> None:
    """Keep a picture of the screen, or of a part of it, in the documents where they are made anew."""
    pixels = cv2.imread(str(picture))
    assert pixels is not None
    pixels = pixels[part]
    if KEEPS_PICTURES:
        assert cv2.imwrite(str(PICTURES / f"{name}.jpg"), pixels, JPEG)


def wait_for_calm(window: BlenderWindow) -> None:
    """Wait for frames; for a picture that is kept, for those of the behaviour, and for a moment without a warning."""
    window.wait(lambda s: received(s) > (TESTED_FRAMES if KEEPS_PICTURES else CAPTURED), "frames", GUIDED_S)
    limit = time.monotonic() + (CALM_S if KEEPS_PICTURES else 0.0)
    while window.state()["capture"].get("notices") and time.monotonic() < limit:
        time.sleep(0.1)


@pytest.mark.pictures
def test_a_new_character_moves_after_three_clicks(desktop: Desktop, window: BlenderWindow) -> None:
    """From a start of Blender with the extension installed: N, the tab, Start Capture."""
    begun_s = time.monotonic()
    window.open_tab("Perfanim")  # it tries the tabs one after the other; a person clicks on one
    desktop.screenshot("first-hour-1-tab")
    desktop.click(*window.tall_button("first-hour-2-start"))
    window.wait(lambda s: received(s) > 0 and s["armature"], "a character that moves")
    seconds = time.monotonic() - begun_s
    print(f"N, a tab, Start Capture: a character moves after {seconds:.0f} s")  # noqa: T201
    desktop.screenshot("first-hour-3-moving")
    desktop.click(*window.tall_button("first-hour-4-stop"))
    window.wait(lambda s: s["capture"]["activity"] is None, "end")
    desktop.screenshot("first-hour-5-stopped")


@pytest.mark.pictures
def test_the_sidebar_during_a_capture(desktop: Desktop, window: BlenderWindow) -> None:
    hand = opened(desktop, window, "sidebar")  # without the cube
    hand.toggle("Capture")
    window.order("set", values={"overlay": ["MARKERS"], "behaviour": "boxing"})
    desktop.click(*window.tall_button("sidebar-start"))
    wait_for_calm(window)
    keep(desktop.screenshot("sidebar-live"), "sidebar")


@pytest.mark.pictures
def test_the_guide_leads_from_cameras_to_a_capture(desktop: Desktop, window: BlenderWindow) -> None:
    hand = opened(desktop, window, "guide")
    for step, picture in follow_guide(window, hand):
        if step in KEPT_STEPS:
            keep(picture, KEPT_STEPS[step])
        if step == "exposure":
            assert "calibrate the cameras" in window.order("call", operator="start_capture")["error"]
        elif step == "board":
            wait_for_corners(desktop, window)
        elif step == "floor":
            assert window.state()["preview"] == NO_PREVIEW
        elif step == "ready":
            window.order("set", values={"capture_preview": True})
        elif step == "live":
            window.wait(lambda s: s["preview"]["shown"], "what the cameras see")
    state = window.state()
    assert state["preview"] == NO_PREVIEW
    (action,) = state["actions"].values()
    assert action["keys_min"] == action["keys_max"] == round(action["last"]) >= 24  # a second of the scene
    # what was recorded begins in a T pose, seen by calibrated cameras
    confidence = window.order("last_run")["confidence"]
    assert np.median(confidence[:OPENING]) > 0.5
    assert np.median(confidence) > 0.5


def wait_for_corners(desktop: Desktop, window: BlenderWindow) -> None:
    """Look at the screen until the viewport shows a board with its corners marked, as the preview does."""
    limit = time.monotonic() + DRAWING_S
    while True:
        view = window.state()["regions"]["WINDOW"]
        left, top = map(int, window.from_top(view, 0, 0))
        pixels = desktop.seen()[top : top + view[3], left : left + view[2]].astype(int)
        marked = int((np.abs(pixels - CORNER_COLOUR).max(axis=2) < 40).sum())
        if marked > LEAST_MARKED_PX:
            return
        assert time.monotonic() < limit, f"{marked} pixels of the corners' colour"
