"""The first hour: a new Blender to a moving character, and the guide through all steps on simulated cameras.

`make pictures` keeps pictures of it in docs/pictures; otherwise they lie in out/window.
"""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from desktop import DRAWING_S, ROOT, BlenderWindow, Desktop
from pointing import Hand
from test_walkthrough import opened, received, wait_for_frames

PICTURES = ROOT / "docs" / "pictures"
JPEG = [cv2.IMWRITE_JPEG_QUALITY, 88]
KEEPS_PICTURES = "PERFANIM_KEEP_PICTURES" in os.environ
SHOWN_FRAMES = 330  # of the capture on the picture: past the T pose
GUIDED_S, CALM_S = 400.0, 60.0


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
    """Wait for enough frames, then a little for a moment without a warning, which a busy machine may not have."""
    window.wait(lambda s: received(s) > SHOWN_FRAMES, "frames", GUIDED_S)
    limit = time.monotonic() + CALM_S
    while window.state()["capture"].get("notice") and time.monotonic() < limit:
        time.sleep(0.1)


def press(window: BlenderWindow, hand: Hand, button: str, panel: str) -> str:
    """Click on the guide's button, wait for the end of its work, and return what the panel says."""
    hand.away()
    hand.click(button, sidebar=True)
    window.wait(lambda s: s["capture"]["activity"], f"start of {button}", DRAWING_S)
    state = window.wait(lambda s: s["capture"]["activity"] is None, f"end of {button}", GUIDED_S)
    return str(state["capture"]["messages"].get(panel))


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
    hand.toggle("Guide")
    hand.shot("cameras")
    hand.click("Practise Calibration", sidebar=True, lowest=True)  # the sentence above names it, too
    window.order("set", values={"practise_fault": "REFLECTION", "behaviour": "walking"})
    hand.shot("exposure")
    press(window, hand, "Check Setup", "guide")
    assert window.state()["preview"]["shown"]
    keep(hand.shot("reflection"), "guide-fault")
    window.order("set", values={"practise_fault": "NONE"})
    assert press(window, hand, "Check Setup", "guide") == "no fault was found"
    hand.shot("calibrate")
    assert press(window, hand, "Calibrate with Board", "cameras").startswith("good")
    hand.shot("floor")
    assert press(window, hand, "Set Floor from Board", "cameras").startswith("floor set")
    hand.shot("markers")
    said = press(window, hand, "Check Setup", "guide")
    assert said.startswith("no fault was found; you may walk"), said
    keep(hand.shot("performer"), "guide")
    assert "residual" in press(window, hand, "Calibrate Performer", "subject")
    hand.shot("ready")
    hand.click("Start Capture", sidebar=True)
    wait_for_frames(window, SHOWN_FRAMES)
    hand.shot("live")
    hand.click("Stop Capture", sidebar=True)
    ended = window.wait(lambda s: s["capture"]["activity"] is None, "end")
    hand.shot("walk-test")
    assert ended["capture"]["walk"].startswith("captures will be "), ended["capture"]
