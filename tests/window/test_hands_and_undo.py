"""Hands, Clean Up Motion and Adjust by mouse on a keyed take, and Ctrl+Z after each."""

import time
from typing import Any

import pytest
from desktop import BlenderWindow, Desktop
from pointing import Hand

UNDONE_S = 3.0  # in which a key that is not lost has undone a step
FRAMES = [1, 10, 20]
BONES = ["hips", "hand.L", "toes.R"]


@pytest.fixture
def hand(desktop: Desktop, window: BlenderWindow) -> Hand:
    """A sidebar with a character that has an action of some frames."""
    window.open_tab("Perfanim")
    window.order("set", values={"record_length_s": 0.5})
    assert "error" not in window.order("call", operator="start_or_stop")
    window.wait(lambda s: s["actions"].get("Capture"), "an action")
    window.wait(lambda s: s["capture"]["activity"] is None, "the end of the capture")
    return Hand(desktop, window, "edits")


def shown(window: BlenderWindow) -> Any:
    name = window.state()["armature"]
    return window.order("joints", object=name, bones=BONES, frames=FRAMES)["joints"]


def undone(desktop: Desktop, window: BlenderWindow, hand: Hand, before: Any) -> None:
    """Press Ctrl+Z over the view until the joints are where they were; one press is enough, unless it is lost."""
    for _ in range(3):
        hand.away()
        desktop.key("ctrl+z")
        limit = time.monotonic() + UNDONE_S
        while time.monotonic() < limit:
            if shown(window) == before:
                return
            time.sleep(0.2)
    raise AssertionError(f"undo has not brought the motion back: {hand.shot('not-undone')}")


def test_edits_are_made_by_mouse_and_undone_by_ctrl_z(desktop: Desktop, window: BlenderWindow, hand: Hand) -> None:
    first = shown(window)
    keys = window.state()["actions"]["Capture"]["keys_max"]
    hand.toggle("Capture")
    hand.toggle("Clean Up Motion")
    hand.shot("clean-up")
    hand.click("Mirror", sidebar=True)
    window.wait(lambda s: "Mirror" in s["capture"]["messages"].get("clean_up", ""), "a mirrored motion")
    hand.shot("mirrored")
    assert shown(window) != first
    undone(desktop, window, hand, first)
    hand.toggle("Clean Up Motion")
    hand.toggle("Takes")
    hand.click("Put on Character", sidebar=True)
    window.wait(lambda s: len(s["actions"]) == 2, "the action of the take")
    hand.shot("put-on-character")
    hand.away()
    desktop.key("ctrl+z")
    window.wait(lambda s: list(s["actions"]) == ["Capture"], "undo of the insertion")
    assert shown(window) == first
    hand.toggle("Takes")
    hand.toggle("Character")
    hand.shot("character")
    hand.toggle("Hands")
    hand.shot("hands")
    hand.click("Both", sidebar=True)
    window.wait(lambda s: s["capture"]["messages"].get("hands"), "posed hands")
    assert window.state()["actions"]["Capture"]["keys_min"] < keys
    hand.shot("posed")
    hand.away()
    desktop.key("ctrl+z")
    window.wait(lambda s: s["actions"]["Capture"]["keys_min"] == keys, "the take's own keys of the fingers")
    hand.toggle("Hands")
    hand.toggle("Adjust")
    hand.shot("adjust")
    hand.type_over("Hip Height", "50", beside=150.0, sidebar=True)
    window.wait(lambda s: shown(window) != first, "higher hips")
    hand.shot("adjusted")
    undone(desktop, window, hand, first)
