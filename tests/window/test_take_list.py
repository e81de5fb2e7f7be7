"""The Takes panel: a recording by others is imported, played on a character, deleted and had back."""

import time
from pathlib import Path

from desktop import BlenderWindow, Desktop

FRAMES = 443
CAPTURE = 5  # panels above it
HEADER_PX = 28  # height of a closed panel
HEADER_TOP_PX = 14


def test_a_two_webcams_take_is_imported_and_played(
    desktop: Desktop, window: BlenderWindow, shared_dir: Path, user: Path
) -> None:
    window.open_tab("Perfanim")
    window.order("set", values={"marker_set": "two-webcams", "subject_height": 1.6})
    folder = shared_dir.resolve() / "two-webcams"
    files = [{"name": "sequence4_published.trc"}]
    window.order("call", operator="import_takes", arguments={"directory": str(folder), "files": files, "up": "feet"})
    window.wait(lambda s: s["capture"]["messages"].get("takes") == "1 take imported", "the imported take")
    (path,) = user.rglob("sequence4_published*.perftake")
    assert "result" in window.order("call", operator="play_take", arguments={"path": str(path)})
    state = window.wait(lambda s: s["actions"], "action of the take")
    (action,) = state["actions"].values()
    assert action["keys_min"] == action["keys_max"] == FRAMES
    for panel in (CAPTURE, CAPTURE + 1):  # the one closes, the one below it opens
        region = window.state()["regions"]["UI"]
        desktop.click(*window.from_top(region, 60, HEADER_TOP_PX + panel * HEADER_PX))
        time.sleep(2.0)
    desktop.screenshot("takes-4-imported")
    assert "result" in window.order("call", operator="delete_take", arguments={"path": str(path)})
    (deleted,) = user.rglob("deleted/*.perftake")
    window.order("set", values={})  # draws the panel again, as a click would
    time.sleep(2.0)
    desktop.screenshot("takes-5-deleted")
    assert "result" in window.order("call", operator="restore_take", arguments={"take": str(deleted)})
    assert path.exists()
