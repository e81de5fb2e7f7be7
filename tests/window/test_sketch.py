"""From an empty file to a walking character by mouse and keyboard: six keys, solved, then edited live."""

import time

from desktop import BlenderWindow, Desktop
from pointing import Hand

FRAMES = 36  # between the keys
WAY_M = 1.2


def test_a_walk_from_six_keys(desktop: Desktop, window: BlenderWindow) -> None:
    window.open_tab("Perfanim")
    hand = Hand(desktop, window, "sketch")
    hand.away()
    for key in ("x", "Return"):  # the cube
        desktop.key(key)
        time.sleep(0.7)
    hand.toggle("Capture")
    hand.toggle("Sketch Motion")
    hand.shot("empty")
    hand.click("Add Controls", sidebar=True)
    window.wait(lambda state: state["armature"], "a character")
    hand.shot("controls")
    press(hand, desktop, "i")
    for _ in range(FRAMES):
        desktop.key("Right")
        time.sleep(0.05)
    press(hand, desktop, "g", "y", "minus", *(c if c.isdigit() else "period" for c in str(WAY_M)), "Return")
    press(hand, desktop, "i")
    hand.shot("keyed")
    hand.click("Solve Sketch", sidebar=True)
    solved = window.wait(lambda state: "keys are met" in state["capture"]["messages"].get("sketch", ""), "a motion")
    (action,) = (facts for name, facts in solved["actions"].items() if "sketch" in name and "Performer" in name)
    assert action["keys_min"] == action["keys_max"] == FRAMES + 1
    for step in range(6):
        hand.shot(f"walk-{step}")
        for _ in range(FRAMES // 6):
            desktop.key("Left")
            time.sleep(0.05)
    hand.click("Live", sidebar=True)
    window.wait(lambda state: state["capture"]["messages"].get("sketch", "") != "", "the first live solution")
    time.sleep(5.0)  # the worker reads the database
    before = window.state()["pose"]
    press(hand, desktop, "g", "y", "period", "2")  # dragged, not confirmed yet
    window.wait(lambda state: state["pose"] != before, "a body that follows")
    hand.shot("dragged")
    desktop.key("Escape")


def press(hand: Hand, desktop: Desktop, *keys: str) -> None:
    """Press keys over the 3D view."""
    hand.away()
    for key in keys:
        desktop.key(key)
        time.sleep(0.25)
    time.sleep(0.7)
