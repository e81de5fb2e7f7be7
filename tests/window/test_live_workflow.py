"""A capture with a countdown that ends by itself, over a playing timeline, while its worker is killed."""

import os
import signal
import time
from pathlib import Path

from desktop import BlenderWindow, Desktop


def test_a_counted_down_capture_outlives_its_worker_and_ends_by_itself(desktop: Desktop, window: BlenderWindow) -> None:
    window.open_tab("Perfanim")
    values = {"record_countdown_s": 5, "record_length_s": 1.5, "smoothing_ms": 30.0, "feet": "auto"}
    window.order("set", values=values)
    desktop.click(*window.tall_button("workflow-1-start"))
    window.wait(lambda s: s["capture"].get("statistics", {}).get("received", 0) > 0, "poses")
    desktop.screenshot("workflow-2-countdown")
    assert not window.state()["actions"]
    view = window.state()["regions"]["WINDOW"]
    desktop.move(*window.from_top(view, view[2] * 0.3, view[3] * 0.6))
    desktop.key("space")  # plays the timeline
    time.sleep(1.0)
    (solver,) = [process for process in workers(window._process.pid) if parent(process) not in workers()]
    received = window.state()["capture"]["statistics"]["received"]
    os.kill(solver, signal.SIGKILL)
    window.wait(lambda s: s["capture"].get("statistics", {}).get("received", 0) > received + 5, "the capture to go on")
    desktop.screenshot("workflow-3-replaced")
    state = window.wait(lambda s: s["capture"]["activity"] is None, "its end by itself")
    desktop.screenshot("workflow-4-ended")
    run = window.order("last_run")
    assert run["numbers"] == sorted(set(run["numbers"]))
    (action,) = state["actions"].values()
    assert action["keys_min"] == action["keys_max"]
    # a second and a half at the scene's 24 frames a second; what came in the countdown is not among them
    assert action["keys_max"] <= 36 + 1
    message = state["capture"]["messages"]["capture"]
    assert 0 < int(message.partition(" frames recorded")[0]) < run["poses"]
    desktop.key("space")


def workers(ancestor: int = 1) -> set[int]:
    """Return the processes below another that were started as workers."""
    found = set()
    for command in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            is_worker = b"core/system/helper_process.py" in command.read_bytes()
        except OSError:
            continue
        above = [int(command.parent.name)]
        while is_worker and above[-1] > 1:
            above.append(parent(above[-1]))
        found |= {above[0]} if is_worker and (ancestor == 1 or ancestor in above) else set()
    return found


def parent(process: int) -> int:
    """Return the parent of a process."""
    try:
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0
