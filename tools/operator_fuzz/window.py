"""Sequences in a window during a live capture."""

import contextlib
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "helpers"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "window"))

from desktop import BlenderWindow, Desktop, build_archive, install

from .errors import errors_in

_BETWEEN_S = 0.1  # pause between steps, in which the capture continues
_POINTER_PX = 300  # distance from the screen's left and top, over the 3D view
_START_S = 30.0  # time until the first pose; another step may have ended the capture earlier


def run_window(seed: int, first: int, stop: int, until_s: float) -> Iterator[dict[str, Any]]:
    """Yield the result of each sequence; if Blender exits, another one is started."""
    wrapper = os.environ["BLENDER"]
    with tempfile.TemporaryDirectory(prefix="operator-fuzz-") as name:
        installed = Path(name) / "installed"
        install(wrapper, build_archive(), installed)
        desktop = Desktop(wrapper, Path(name) / "pictures")
        try:
            at = first
            while at < stop and time.time() < until_s:
                folder = Path(name) / str(at)
                shutil.copytree(installed, folder / "user", symlinks=True)
                for result in run_in(desktop, folder, seed, range(at, stop), until_s):
                    at = result["number"] + 1
                    yield result
        finally:
            desktop.close()


def run_in(desktop: Desktop, folder: Path, seed: int, numbers: range, until_s: float) -> Iterator[dict[str, Any]]:
    """Yield results until Blender exits, or all are done.

    Args:
        folder: A separate folder, with Blender's user folder as `user` in it.
    """
    (folder / "tmp").mkdir()
    desktop.environment["TMPDIR"] = str(folder / "tmp")
    with contextlib.chdir(folder):  # for relative paths
        window = BlenderWindow(desktop, folder / "user", folder / "observer")
    try:
        for number in numbers:
            if time.time() > until_s:
                return
            result = {"number": number, **_sequence(desktop, window, folder, seed, number)}
            yield result
            if result["ended"]:
                return
    finally:
        window.close()


def _sequence(desktop: Desktop, window: BlenderWindow, folder: Path, seed: int, number: int) -> dict[str, Any]:
    """Start a capture, take the steps of a sequence, and end it.

    The pointer moves before each step, as it does before a click. Blender 4.3 exits if an operator starts to run
    without any event since a running operator's class was removed.
    """
    said, ended = len(window.log()), False
    lines: list[str] = []
    faults: list[str] = []
    try:
        begun = _order(window, "fuzz_begin", faults, seed=seed, sequence=number, folder=str(folder))
        started = _order(window, "call", faults, operator="start_capture")
        lines.append(f"start_capture {json.dumps(started)}")
        limit_s = time.monotonic() + _START_S
        while time.monotonic() < limit_s and _is_starting(window.state()):
            time.sleep(0.05)
        for step in range(begun.get("steps", 0)):
            desktop.move(_POINTER_PX + step % 2, _POINTER_PX)
            lines.append(_order(window, "fuzz_step", faults).get("line", ""))
            time.sleep(_BETWEEN_S)
        left = _order(window, "fuzz_end", faults).get("left", [])
    except AssertionError as error:  # Blender has exited, or does not respond
        ended, left = True, [str(error)[:2000]]
    faults += errors_in(window.log()[said:]) + left
    return {"faults": faults, "steps": lines if faults else len(lines), "ended": ended}


def _order(window: BlenderWindow, what: str, faults: list[str], **details: Any) -> dict[str, Any]:
    answer = window.order(what, **details)
    if what.startswith("fuzz") and "error" in answer:
        faults.append(f"{what}: {answer['error']}")
    return answer


def _is_starting(state: dict[str, Any]) -> bool:
    capture = state["capture"]
    return capture.get("activity") == "LiveCapture" and not capture.get("statistics", {}).get("received")
