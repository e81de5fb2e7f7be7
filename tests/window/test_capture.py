"""A capture as an animator does it: install, open the sidebar, click Start Capture, click Stop."""

import json
import time
from typing import Any

from desktop import ROOT, BlenderWindow, Desktop

WATCHED_S = 5.0
MEASURED_S = 10.0


def started(desktop: Desktop, window: BlenderWindow, name: str) -> None:
    """Open the tab and click Start Capture."""
    window.open_tab("Perfanim")
    desktop.click(*window.tall_button(f"{name}-1-tab"))
    wait_for_frames(window)


def over_the_view(desktop: Desktop, window: BlenderWindow) -> None:
    """Put the pointer over the 3D view, which then gets the keys."""
    view = window.state()["regions"]["WINDOW"]
    desktop.move(*window.from_top(view, view[2] * 0.3, view[3] * 0.6))
    time.sleep(0.5)


def wait_for_frames(window: BlenderWindow) -> None:
    """Wait until poses come, or fail with what the panel says."""

    def running_or_ended(state: dict[str, Any]) -> bool:
        capture = state["capture"]
        return capture.get("phase") == "RUNNING" or capture["activity"] is None

    window.wait(lambda state: state["capture"]["activity"] == "Capture" or state["capture"]["messages"], "a start")
    state = window.wait(running_or_ended, "capture that runs")
    assert state["capture"].get("phase") == "RUNNING", state["capture"]["messages"]


def test_start_and_stop_with_the_mouse(desktop: Desktop, window: BlenderWindow) -> None:
    over_the_view(desktop, window)
    desktop.key("Escape")  # the splash screen
    time.sleep(1.0)
    over_the_view(desktop, window)
    desktop.key("x")  # the cube of Blender's first scene stands where the character will
    time.sleep(1.0)
    desktop.key("Return")
    started(desktop, window, "capture")
    window.wait(lambda state: state["armature"], "character")
    over_the_view(desktop, window)
    desktop.key("KP_Decimal")  # look at the character
    poses = set()
    until = time.monotonic() + WATCHED_S
    while time.monotonic() < until:
        poses.add(window.state()["pose"])
        time.sleep(0.2)
    assert len(poses) >= 10, "the bones do not move"
    desktop.screenshot("capture-2-live")
    time.sleep(MEASURED_S + 2.0)
    live = window.order("rates", seconds=MEASURED_S)
    desktop.click(*window.tall_button("capture-3-stop-button"))
    state = window.wait(lambda s: s["capture"]["activity"] is None, "end of the capture")
    time.sleep(1.0)
    desktop.screenshot("capture-4-stopped")
    assert not state["capture"]["timer"]

    run = window.order("last_run")
    check_nothing_is_lost(run)
    check_action(state, run["poses"])
    bare = window.order("bare_timer", seconds=MEASURED_S + 1.5)
    report = {"capture": live, "bare_timer": bare, "statistics": run["statistics"]}
    (ROOT / "out" / "window" / "capture.json").write_text(json.dumps(report, indent=1))
    assert live["changes_per_s"] >= 0.9 * bare["changes_per_s"], report


def check_nothing_is_lost(run: dict[str, Any]) -> None:
    figures = run["statistics"]
    assert figures["handed_over"] == figures["received"] == run["poses"]
    assert run["numbers"] == sorted(set(run["numbers"]))
    assert run["distinct"] > 0.9 * run["poses"]


def check_action(state: dict[str, Any], poses: int) -> None:
    (action,) = state["actions"].values()
    assert action["keys_min"] == action["keys_max"] == poses
    assert action["paths"] == ["location", "rotation_quaternion"]
    assert action["curves"] == 29 * 4 + 3
    assert action["groups"] == 29


def test_escape_ends_and_keeps_and_one_undo_takes_it_back(desktop: Desktop, window: BlenderWindow) -> None:
    started(desktop, window, "escape")
    time.sleep(3.0)
    over_the_view(desktop, window)
    desktop.key("Escape")
    state = window.wait(lambda s: s["capture"]["activity"] is None, "end of the capture")
    run = window.order("last_run")
    check_nothing_is_lost(run)
    check_action(state, run["poses"])
    desktop.key("ctrl+z")
    window.wait(lambda s: not s["actions"] and not s["armature"], "undo of the whole capture")
    desktop.key("ctrl+shift+z")
    redone = window.wait(lambda s: s["actions"], "redo of the capture")
    check_action(redone, run["poses"])


def test_a_second_capture_uses_the_same_character(desktop: Desktop, window: BlenderWindow) -> None:
    started(desktop, window, "second")
    for number in (1, 2):
        if number > 1:
            desktop.click(*window.tall_button(f"second-{number}-start"))
            window.wait(lambda s: s["capture"]["activity"] == "Capture", "second start")
            wait_for_frames(window)
        time.sleep(2.0)
        desktop.click(*window.tall_button(f"second-{number}-stop"))
        state = window.wait(lambda s: s["capture"]["activity"] is None, "end of the capture")
        assert len(state["actions"]) == number
        assert state["armature"] == "Performer"
