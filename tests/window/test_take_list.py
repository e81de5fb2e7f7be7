"""The Takes panel: a recording by others is imported, played on a character, deleted and had back."""

import time
from pathlib import Path

from desktop import BlenderWindow, Desktop
from pointing import Hand

FRAMES = 443


def test_a_two_webcams_take_is_imported_and_played(
    desktop: Desktop, window: BlenderWindow, shared_dir: Path, user: Path
) -> None:
    window.open_tab("Perfanim")
    window.order("set", values={"marker_set": "two-webcams", "subject_height": 1.6})
    folder = shared_dir.resolve() / "two-webcams"
    files = [{"name": "sequence4_published.trc"}]
    before = set(user.rglob("*.perftake"))  # of other tests
    window.order("call", operator="import_takes", arguments={"directory": str(folder), "files": files, "up": "feet"})
    window.wait(lambda s: s["capture"]["messages"].get("takes") == "1 take imported", "the imported take")
    (path,) = set(user.rglob("*.perftake")) - before
    assert "result" in window.order("call", operator="play_take", arguments={"path": str(path)})
    state = window.wait(lambda s: s["actions"], "action of the take")
    (action,) = state["actions"].values()
    assert action["keys_min"] == action["keys_max"] == FRAMES
    hand = Hand(desktop, window, "takes")
    hand.toggle("Capture")  # the one closes, the one below it opens
    hand.toggle("Takes")
    time.sleep(2.0)
    desktop.screenshot("takes-4-imported")
    assert "result" in window.order("call", operator="delete_take", arguments={"path": str(path)})
    (deleted,) = user.rglob(f"deleted/{path.name}")
    window.order("set", values={})  # draws the panel again, as a click would
    time.sleep(2.0)
    desktop.screenshot("takes-5-deleted")
    assert "result" in window.order("call", operator="restore_take", arguments={"take": str(deleted)})
    assert path.exists()
