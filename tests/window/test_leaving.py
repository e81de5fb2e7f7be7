"""Whatever happens to Blender while a capture is live, the capture goes on or ends, and nothing of it is left."""

import time
from pathlib import Path
from typing import Any

from desktop import BlenderWindow, Desktop

SOME_FRAMES = 10


def start(window: BlenderWindow) -> None:
    """Start a capture and wait for its first frames."""
    assert "result" in window.order("call", operator="start_capture")
    wait_for_more(window)


def wait_for_more(window: BlenderWindow) -> None:
    """Wait until some more frames have come than have now."""
    before = received(window.state())
    window.wait(lambda state: received(state) >= before + SOME_FRAMES, "more frames")


def received(state: dict[str, Any]) -> int:
    return int(state["capture"].get("statistics", {}).get("received", 0))


def ended(window: BlenderWindow, what: str) -> dict[str, Any]:
    state = window.wait(lambda s: s["capture"]["activity"] is None, what)
    assert not state["capture"]["timer"]
    assert state["preview"] == {"shown": False, "image": False}
    return state


def test_whatever_ends_a_capture_leaves_nothing(desktop: Desktop, window: BlenderWindow) -> None:
    window.order("addon", on=False)
    before = window.order("remains")
    assert not {"classes", "properties", "operators", "drawn", "timers", "processes"} & set(before)
    window.order("addon", on=True)

    start(window)
    assert window.order("remains")["processes"]
    window.order("workspace", name="Animation")
    wait_for_more(window)
    desktop.screenshot("leaving-1-other-workspace")
    window.order("workspace", name="Layout")
    wait_for_more(window)
    window.order("remove_armature")
    state = ended(window, "end without an armature")
    assert "Performer" in state["capture"]["messages"]["capture"]
    assert " frames recorded in Capture" in state["capture"]["messages"]["capture"]
    assert len(state["actions"]) == 1, "the recording is kept on a new character"
    time.sleep(2.0)  # until it is drawn
    desktop.screenshot("leaving-2-armature-deleted")

    window.order("step", name="Before")
    start(window)
    for operator, there in (("undo", False), ("redo", True)):
        assert ("Before" in window.order("undo", operator=operator)["objects"]) == there
        wait_for_more(window)
    window.order("new_file")
    state = ended(window, "end by another file")
    assert not state["actions"]

    start(window)
    window.order("addon", on=False)
    assert window.order("remains") == before
    desktop.move(*(0.4 * size for size in desktop.size))  # Blender forgets an operator at the next event only
    desktop.move(*(0.5 * size for size in desktop.size))
    window.order("addon", on=True)

    start(window)
    processes = window.order("remains")["processes"]
    window.order("quit")
    assert window.wait_for_end() == 0
    assert [process for process in processes if Path(f"/proc/{process}").exists()] == []
    for word in ("Traceback", "Exception", "ReferenceError", "leak"):
        assert word not in window.log(), window.log()


def test_quitting_during_the_first_capture_of_a_file_asks(desktop: Desktop, window: BlenderWindow) -> None:
    window.open_tab("Perfanim")
    start(window)
    view = window.state()["regions"]["WINDOW"]
    desktop.move(*window.from_top(view, view[2] * 0.3, view[3] * 0.5))
    desktop.key("ctrl+q")
    time.sleep(3.0)
    desktop.screenshot("leaving-3-asks")
    wait_for_more(window)  # Blender is still there, and so is the capture
    desktop.key("Escape")
    time.sleep(1.0)
    assert "result" in window.order("call", operator="stop_capture")
    state = ended(window, "end of the capture")
    assert len(state["actions"]) == 1
    window.order("undo", operator="undo")  # still one step
    assert not window.state()["actions"]
