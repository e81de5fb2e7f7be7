"""A screen without a monitor, a real Blender on it, and a hand on its mouse and keyboard.

BLENDER names a program that runs its arguments where Blender, Xvfb, xdotool and ImageMagick's import are installed
(`../shared/tools/blender-root trixie` makes one), with the caller's environment, /tmp and working tree visible there.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
OBSERVER = Path(__file__).with_name("observer.py")
PATIENCE_S = 180.0
CALM_S = 1.0  # in which what has just been asked for is drawn, if the machine is not busy
DRAWING_S = 30.0  # in which a busy machine has drawn the sidebar again


class Desktop:
    """One X display; end it with `close`."""

    def __init__(self, wrapper: str, pictures: Path, size: tuple[int, int] = (1280, 800)) -> None:
        self.wrapper = wrapper
        self.size = size
        self._pictures = pictures
        pictures.mkdir(parents=True, exist_ok=True)
        screen = f"{size[0]}x{size[1]}x24"
        self._server = subprocess.Popen(
            [wrapper, "Xvfb", "-displayfd", "1", "-screen", "0", screen, "+extension", "GLX", "-nolisten", "tcp"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self._server.stdout is not None
        self._number = self._server.stdout.readline().strip()
        assert self._number, "Xvfb did not start"
        self.environment = {**os.environ, "DISPLAY": f":{self._number}"}

    def run(self, *command: str) -> str:
        """Run a program on the display."""
        done = subprocess.run(
            [self.wrapper, *command], env=self.environment, check=True, capture_output=True, text=True, timeout=60
        )
        return done.stdout

    def screenshot(self, name: str) -> Path:
        """Save a picture of the screen."""
        path = self._pictures / f"{name}.png"
        self.run("import", "-window", "root", str(path))
        return path

    def seen(self) -> np.ndarray:
        """Return the pixels of the screen (height, width, 3) in OpenCV's order, without keeping a picture."""
        # of this display, because another may be looked at meanwhile; quicker than compressing it
        path = self._pictures / f"seen{self._number}.ppm"
        self.run("import", "-window", "root", str(path))
        pixels = cv2.imread(str(path))
        path.unlink()
        assert pixels is not None
        return pixels

    def wait_until_calm(self) -> None:
        """Wait until two pictures in succession are the same, or for a second: a capture changes them always."""
        limit = time.monotonic() + CALM_S
        last = self.seen()
        while time.monotonic() < limit:
            time.sleep(0.2)
            now = self.seen()
            if np.array_equal(now, last):
                return
            last = now

    def move(self, x: float, y: float) -> None:
        """Move the pointer; (0, 0) is the top left."""
        self.run("xdotool", "mousemove", str(round(x)), str(round(y)))

    def click(self, x: float, y: float, button: int = 1) -> None:
        """Click at a place, as slowly as a person, for Blender must see the pointer arrive first."""
        self.move(x, y)
        time.sleep(0.3)
        self.run("xdotool", "mousedown", str(button))
        time.sleep(0.08)
        self.run("xdotool", "mouseup", str(button))

    def drag(self, places: Sequence[tuple[float, float]]) -> None:
        """Draw with the left button held from place to place, as slowly as a person."""
        self.move(*places[0])
        time.sleep(0.5)
        self.run("xdotool", "mousedown", "1")
        for place in places:
            self.move(*place)
            time.sleep(0.03)
        time.sleep(0.3)
        self.run("xdotool", "mouseup", "1")

    def key(self, name: str) -> None:
        """Press a key."""
        self.run("xdotool", "key", name)

    def bring_in(self, title: str) -> None:
        """Move a window whole onto the screen, as a window manager does."""
        self.run("xdotool", "search", "--sync", "--onlyvisible", "--name", title, "windowmove", "40", "40")
        time.sleep(1.0)

    def put_away(self, title: str) -> None:
        """Take a window off the screen, as a click on the cross does that a window manager draws."""
        self.run("xdotool", "search", "--onlyvisible", "--name", title, "windowunmap")
        time.sleep(1.0)

    def close(self) -> None:
        """End the display."""
        self._server.terminate()
        self._server.wait()


class BlenderWindow:
    """A Blender that fills the display, with the observer's reports."""

    def __init__(self, desktop: Desktop, user: Path, folder: Path, *arguments: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._desktop = desktop
        self._state = folder / "state.json"
        self._orders = folder / "order.json"
        self._log = (folder / "blender.log").open("wb")
        environment = {**desktop.environment, "BLENDER_USER_RESOURCES": str(user), "OBSERVER_FOLDER": str(folder)}
        width, height = desktop.size
        geometry = ["--window-geometry", "0", "0", str(width), str(height)]
        self._process = subprocess.Popen(
            [desktop.wrapper, "blender", *geometry, *arguments, "--python", str(OBSERVER)],
            env=environment,
            stdout=self._log,
            stderr=subprocess.STDOUT,
        )
        self.wait(lambda state: state["ticks"] > 10, "a window")

    def state(self) -> dict[str, Any]:
        """Return the observer's last report."""
        try:
            return json.loads(self._state.read_text())
        except FileNotFoundError:
            return {"ticks": 0}

    def wait(self, until: Callable[[dict[str, Any]], Any], what: str, patience_s: float = PATIENCE_S) -> dict[str, Any]:
        """Return the first report for which `until` holds."""
        limit = time.monotonic() + patience_s
        while not until(state := self.state()):
            assert self._process.poll() is None, f"Blender ended while waiting for {what}: {self.log()[-3000:]}"
            assert time.monotonic() < limit, f"no {what}: {json.dumps(state)[:3000]}\n{self.log()[-3000:]}"
            time.sleep(0.1)
        return state

    def order(self, what: str, **details: Any) -> dict[str, Any]:
        """Let the observer do something that no user does (measure a bare timer, choose a file); return its answer."""
        number = self.state().get("orders", 0) + 1
        temporary = self._orders.with_suffix(".new")
        temporary.write_text(json.dumps({"number": number, "what": what, **details}))
        temporary.replace(self._orders)
        return self.wait(lambda state: state.get("orders", 0) >= number, f"answer to {what}")["answer"]

    def log(self) -> str:
        """Return what Blender printed."""
        self._log.flush()
        return Path(self._log.name).read_text(errors="replace")

    def from_top(self, region: list[int], x: float, y: float) -> tuple[float, float]:
        """Return screen coordinates of a point (x from the left, y from the top) of a region."""
        left, bottom, _, height = region
        return left + x, self._desktop.size[1] - (bottom + height) + y

    def open_tab(self, name: str) -> None:
        """Open the 3D viewport's sidebar with N and click on its tabs until the wanted one is open."""
        desktop = self._desktop
        state = self.state()
        view = state["regions"]["WINDOW"]
        desktop.move(*self.from_top(view, view[2] * 0.4, view[3] * 0.5))
        time.sleep(0.5)
        desktop.key("Escape")  # the splash screen
        time.sleep(0.5)
        desktop.move(*self.from_top(view, view[2] * 0.4 + 5, view[3] * 0.5 + 5))
        desktop.key("n")
        state = self.wait(lambda s: s["regions"]["UI"][2] > 50, "sidebar")
        for y in range(25, state["regions"]["UI"][3], 30):
            region = self.state()["regions"]["UI"]
            desktop.click(*self.from_top(region, region[2] - 12, y))
            time.sleep(0.4)
            if self.state()["tab"] == name:
                return
        desktop.screenshot("no-tab")
        raise AssertionError(f"no tab {name}: {self.state()['tab']}")

    def tall_button(self, picture_name: str, below: int = 0) -> tuple[float, float]:
        """Return the centre of the tallest button in the sidebar, Start or Stop Capture, on a picture taken for it.

        With `below` that of the first, second, ... button below it.
        """
        view = self.state()["regions"]["WINDOW"]
        self._desktop.move(*self.from_top(view, view[2] * 0.2, view[3] * 0.8))  # a button under the pointer is lighter
        deadline = time.monotonic() + DRAWING_S
        while True:
            time.sleep(0.4)  # as after any movement of the pointer
            self._desktop.wait_until_calm()
            picture = self._desktop.screenshot(picture_name)
            state = self.state()
            region = state["regions"]["UI"]
            left, top = self.from_top(region, 0, 0)
            image = cv2.imread(str(picture))
            assert image is not None, picture
            pixels = image[int(top) : int(top) + region[3], int(left) : int(left) + region[2] - 25, ::-1]
            try:
                x, y = tallest_area(pixels, state["button_colour"], below)
            except AssertionError:  # a busy machine has yet to draw the button without the pointer over it
                if time.monotonic() > deadline:
                    raise
            else:
                return x + left, y + top

    def forget(self) -> None:
        """Remove the last report, for the next Blender with the same folder."""
        self._state.unlink(missing_ok=True)
        self._orders.unlink(missing_ok=True)

    def wait_for_end(self) -> int:
        """Return the status with which Blender has ended by itself."""
        return self._process.wait(timeout=PATIENCE_S)

    def close(self) -> None:
        """End Blender."""
        self._process.terminate()
        try:
            self._process.wait(timeout=20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()


def tallest_area(pixels: np.ndarray, colour: list[int], below: int = 0, tolerance: int = 6) -> tuple[float, float]:
    """Return the centre (x, y) of the tallest area of a button's colour that spans at least 40 % of a picture.

    With `below` that of the first, second, ... area below it.

    Args:
        pixels: (height, width, 3) RGB; colour: (3) RGB, 0-255.
    """
    same = np.abs(pixels.astype(int) - np.array(colour)).max(axis=2) <= tolerance
    inside = np.concatenate(([False], same.mean(axis=1) >= 0.4, [False]))
    edges = np.flatnonzero(np.diff(inside.astype(int)))
    starts, stops = edges[::2], edges[1::2]
    assert len(starts), "no button"
    tallest = int(np.argmax(stops - starts))
    assert stops[tallest] - starts[tallest] >= 24, f"the tallest button has {stops[tallest] - starts[tallest]} rows"
    assert tallest + below < len(starts), "no button below the tallest"
    row = (starts[tallest + below] + stops[tallest + below]) // 2
    columns = np.flatnonzero(same[row])
    return (columns.min() + columns.max()) / 2, float(row)


def build_archive() -> Path:
    """Build the extension's archive."""
    command = [sys.executable, str(ROOT / "tools" / "build_extension.py")]
    done = subprocess.run(
        [*command, "--platform", "linux-x64", "--out", str(ROOT / "out" / "dist")],
        check=True,
        capture_output=True,
        text=True,
    )
    return Path(done.stdout.strip().splitlines()[-1])


def install(wrapper: str, archive: Path, user: Path) -> None:
    """Install an archive as a user does and switch it on."""
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(user)}
    tool = [wrapper, "blender", "--factory-startup", "--command", "extension"]
    subprocess.run([*tool, "validate", str(archive)], check=True, env=environment)
    subprocess.run(
        [wrapper, "blender", "--command", "extension", "install-file", "-r", "user_default", "-e", str(archive)],
        check=True,
        env=environment,
    )
