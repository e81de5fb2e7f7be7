"""A performer away from the desk: large text in a window of its own, started and stopped by a key."""

import time

import numpy as np
from desktop import BlenderWindow, Desktop
from pointing import Hand

FRAMES = 90
BRIGHT = 200
LARGE_PX = 80  # least height of the headline's letters on a screen of 800 pixels


def tallest_letters(picture: np.ndarray) -> int:
    """Return the height of the tallest group of rows with red or white letters in the left half."""
    rows = (picture[:, : picture.shape[1] // 2].max(axis=2) > BRIGHT).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], rows.astype(int), [0]))))
    return int((edges[1::2] - edges[::2]).max(initial=0))


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
    picture = desktop.screenshot("screen-recording")
    assert picture.exists()
    desktop.key("ctrl+shift+r")
    window.wait(lambda s: s["capture"]["activity"] is None, "the end of the capture")
    assert "frames recorded in Capture" in window.state()["capture"]["messages"]["capture"]
    time.sleep(2.0)
    desktop.screenshot("screen-after")
