"""Blender is killed while it captures; the next one offers what was captured."""

import signal
import time
from pathlib import Path

from desktop import BlenderWindow, Desktop
from perfanim.core.formats.take_file.take_reader import read_take_file

LEAST_FRAMES = 40


def start_capture(desktop: Desktop, window: BlenderWindow, picture: str) -> None:
    window.open_tab("Perfanim")
    desktop.click(*window.tall_button(picture))


def test_what_was_captured_before_blender_was_killed_is_recovered_with_one_click(
    desktop: Desktop, user: Path, tmp_path: Path
) -> None:
    window = BlenderWindow(desktop, user, tmp_path / "killed")
    try:
        before = set(user.rglob("*.perftake"))  # of other tests
        start_capture(desktop, window, "takes-1-start")
        window.wait(lambda s: s["capture"].get("statistics", {}).get("received", 0) > LEAST_FRAMES, "poses")
        (path,) = set(user.rglob("*.perftake")) - before
        window._process.send_signal(signal.SIGKILL)
        window._process.wait()
    finally:
        window.close()

    window = BlenderWindow(desktop, user, tmp_path / "next")
    try:
        window.open_tab("Perfanim")
        desktop.click(*window.tall_button("takes-2-offer", below=1))
        state = window.wait(lambda s: s["actions"], "action of the recovered take")
        time.sleep(2.0)  # until it is drawn
        desktop.screenshot("takes-3-recovered")
    finally:
        window.close()
    take = read_take_file(path)
    assert take.complete
    assert take.notes.played
    assert len(take.poses) >= LEAST_FRAMES
    (action,) = state["actions"].values()
    # a key on each of the scene's frames, which are fewer than the poses
    assert action["keys_min"] == action["keys_max"] == round(action["last"]) <= len(take.poses)
