"""From an empty file to a walking character by mouse and keyboard: six keys or a drawn path, solved, edited live."""

import time

import numpy as np
import pytest
from desktop import BlenderWindow, Desktop
from pointing import Hand
from sidebar_steps import opened
from test_first_hour import keep

FRAMES = 36  # between the keys
WAY_M = 1.2
TYPED_WAY = ("minus", *(c if c.isdigit() else "period" for c in str(WAY_M)))
PANEL = (slice(90, 700), slice(330, 1035))  # pixels of the screen with the sidebar and the character
PATH_PX = 220  # down the screen, about two metres ahead of a new character


def with_controls(desktop: Desktop, window: BlenderWindow, name: str) -> Hand:
    """Delete the cube of a new file, and add a character with controls."""
    hand = opened(desktop, window, name)
    hand.toggle("Sketch Motion")
    hand.shot("empty")
    hand.click("Add Controls", sidebar=True)
    window.wait(lambda state: state["armature"], "a character")
    hand.shot("controls")
    return hand


def with_character(desktop: Desktop, window: BlenderWindow, name: str) -> Hand:
    """Delete the cube of a new file, and add a character."""
    hand = opened(desktop, window, name)
    hand.toggle("Character")
    hand.click("Add Character", sidebar=True)
    window.wait(lambda state: state["armature"], "a character")
    hand.toggle("Character")
    hand.toggle("Sketch Motion")
    return hand


@pytest.mark.pictures
def test_a_walk_from_six_keys(desktop: Desktop, window: BlenderWindow) -> None:
    hand = with_controls(desktop, window, "sketch")
    press(hand, desktop, "i")
    key_further_on(hand, desktop)
    hand.shot("keyed")
    hand.click("Solve Sketch", sidebar=True)
    solved = window.wait(lambda state: "keys are met" in state["capture"]["messages"].get("sketch", ""), "a motion")
    (action,) = (facts for name, facts in solved["actions"].items() if "sketch" in name and "Performer" in name)
    assert action["keys_min"] == action["keys_max"] == FRAMES + 1
    hand.find("Sketch Settings", sidebar=True)  # below the message: all of it is on a screen of 800 pixels' height
    for step in range(6):
        picture = hand.shot(f"walk-{step}")
        if step == 3:
            keep(picture, "sketch-panel", PANEL)
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


@pytest.mark.walkthrough
def test_a_walk_along_a_drawn_path(desktop: Desktop, window: BlenderWindow) -> None:
    hand = with_controls(desktop, window, "sketch-path")
    hand.click("Draw Hips Path", sidebar=True)
    window.wait(lambda state: "draw with the left" in state["capture"]["messages"].get("sketch", ""), "a path to draw")
    hand.shot("from-above")
    view = window.state()["regions"]["WINDOW"]
    x, y = window.from_top(view, 0.5 * view[2], 0.5 * view[3])
    down = np.linspace(0.0, 1.0, 40)
    desktop.drag([(x + 60.0 * np.sin(np.pi * share), y + PATH_PX * share) for share in down])
    hand.shot("drawn")
    hand.click("Follow Curve", sidebar=True)
    told = window.wait(lambda state: "follows" in state["capture"]["messages"].get("sketch", ""), "hips on the path")
    last = int(told["capture"]["messages"]["sketch"].rpartition(" ")[2].rstrip("."))
    assert last > FRAMES
    hand.click("Solve Sketch", sidebar=True)
    solved = window.wait(lambda state: "keys are met" in state["capture"]["messages"].get("sketch", ""), "a motion")
    (action,) = (facts for name, facts in solved["actions"].items() if "sketch" in name and "Performer" in name)
    assert action["keys_min"] == action["keys_max"] == last
    press(hand, desktop, "KP_3", "KP_Decimal")  # the path, from the side
    for step in range(6):
        hand.shot(f"walk-{step}")
        for _ in range(last // 6):
            desktop.key("Right")
            time.sleep(0.05)


@pytest.mark.walkthrough
def test_a_rough_rig_becomes_a_walk(desktop: Desktop, window: BlenderWindow) -> None:
    hand = with_character(desktop, window, "sketch-rig")
    press(hand, desktop, "ctrl+Tab", "a", "i")  # the whole pose, moved as one: a character that glides
    key_further_on(hand, desktop)
    hand.shot("rough")
    press(hand, desktop, "ctrl+Tab")
    hand.click("Follow Rough Rig", sidebar=True)
    window.wait(lambda state: "controls follow Rough" in state["capture"]["messages"].get("sketch", ""), "a copy")
    hand.shot("copied")
    hand.click("Solve Sketch", sidebar=True)
    solved = window.wait(lambda state: "keys are met" in state["capture"]["messages"].get("sketch", ""), "a motion")
    (action,) = (facts for name, facts in solved["actions"].items() if "sketch" in name and "Performer" in name)
    assert action["keys_min"] == action["keys_max"] == FRAMES + 1
    for step in range(6):
        hand.shot(f"walk-{step}")
        for _ in range(FRAMES // 6):
            desktop.key("Left")
            time.sleep(0.05)


def key_further_on(hand: Hand, desktop: Desktop) -> None:
    """Key all that is selected `WAY_M` ahead, `FRAMES` later."""
    for _ in range(FRAMES):
        desktop.key("Right")
        time.sleep(0.05)
    press(hand, desktop, "g", "y", *TYPED_WAY, "Return")
    press(hand, desktop, "i")


def press(hand: Hand, desktop: Desktop, *keys: str) -> None:
    """Press keys over the 3D view."""
    hand.away()
    for key in keys:
        desktop.key(key)
        time.sleep(0.25)
    time.sleep(0.7)
