"""A performer away from the desk: large text in a window of its own, started and stopped by a key."""

import time
from pathlib import Path

import pytest
from desktop import BlenderWindow, Desktop
from pointing import Hand

FRAMES = 30
LARGE_PX = 80  # least height of the headline on a screen of 800 pixels


def test_the_performer_reads_the_screen_and_a_key_starts_and_stops(desktop: Desktop, window: BlenderWindow) -> None:
    window.open_tab("Perfanim")
    hand = Hand(desktop, window, "screen")
    hand.click("Performer's Screen", sidebar=True)
    window.wait(lambda s: s["windows"] == 2, "a second window")
    time.sleep(3.0)
    desktop.screenshot("screen-ready")
    desktop.key("ctrl+shift+r")
    window.wait(lambda s: s["capture"].get("statistics", {}).get("received", 0) > FRAMES, "a capture")
    time.sleep(1.0)
    desktop.screenshot("screen-recording")
    is_red = (desktop.seen()[..., 2] > 240) & (desktop.seen()[..., :2] < 100).all(axis=2)
    assert is_red.any(axis=1).sum() > LARGE_PX  # REC
    desktop.key("ctrl+shift+r")
    window.wait(lambda s: s["capture"]["activity"] is None, "the end of the capture")
    assert "frames recorded in Capture" in window.state()["capture"]["messages"]["capture"]
    time.sleep(2.0)
    desktop.screenshot("screen-after")


@pytest.mark.walkthrough
def test_a_second_performer_a_sword_and_a_second_character_beside_the_first(
    desktop: Desktop, window: BlenderWindow
) -> None:
    window.open_tab("Perfanim")
    hand = Hand(desktop, window, "targets")
    hand.toggle("Capture")
    window.order("call", operator="add_character")
    for _ in range(3):
        assert "error" not in window.order("call", operator="add_target")
    window.order("targets", kinds=["PROP", "PERFORMER", "CHARACTER"], armature=window.state()["armature"])
    window.order("set", values={"armature": ""})
    hand.toggle("Additional Targets")
    hand.find("Character")
    hand.shot("listed")
    hand.toggle("Additional Targets")
    hand.toggle("Capture")
    window.order("set", values={"record_length_s": 1.0})
    hand.click("Start Capture", sidebar=True)
    window.wait(lambda s: s["capture"].get("statistics", {}).get("received", 0) > 0, "a capture")
    window.wait(lambda s: s["capture"]["activity"] is None, "the end of the capture")
    hand.shot("ended")
    text = window.state()["capture"]["messages"]["capture"]
    assert "recorded in Capture, Capture sword, Capture Performer 2, Capture Performer: " in text
    assert "never found" not in text


def test_poses_to_take_are_drawn(desktop: Desktop, window: BlenderWindow, calibration: Path) -> None:
    window.open_tab("Perfanim")
    hand = Hand(desktop, window, "poses")
    window.order("set", values={"practise": True, "calibration": str(calibration)})
    hand.click("Performer's Screen", sidebar=True)
    window.wait(lambda s: s["windows"] == 2, "a second window")
    window.order("click", operator="calibrate_performer")
    window.wait(lambda s: "hold still" in s["capture"].get("line", ""), "a pose")
    desktop.screenshot("poses-first")
    window.wait(lambda s: "knees bent" in s["capture"].get("line", ""), "the last pose")
    time.sleep(0.5)
    desktop.screenshot("poses-last")
