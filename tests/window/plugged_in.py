"""Runs a worker for which cameras are plugged in that are not there: they play images from folders.

Started in place of the worker's Python, with its arguments. The environment names the folder (PLUGGED_IN), with
`scene.json` ({"scene": ..., "fps": ...}) and for each scene a folder per device number with images 0.jpg, 1.jpg, ...,
and the program to start further workers with (PLUGGED_IN_PYTHON).
"""

import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import runpy
import sys
import time
from pathlib import Path
from typing import Any

CAMERAS = "perfanim.core.vision.sources.camera_source"
_begun_s: list[float] = []  # all cameras of a process play the same moments


class Played:
    """Stands for `cv2.VideoCapture`: hands an image over when it is due, from the first again after the last."""

    def __init__(self, device: int) -> None:
        import cv2

        folder = Path(os.environ["PLUGGED_IN"])
        playing = json.loads((folder / "scene.json").read_text())
        self._cv2 = cv2
        self._fps = float(playing["fps"])
        self._folder = folder / playing["scene"] / str(device)
        self._images = len(list(self._folder.glob("*.jpg")))
        self._told = {cv2.CAP_PROP_FPS: self._fps}
        self._number = -1
        if not _begun_s:
            _begun_s.append(time.monotonic())

    def isOpened(self) -> bool:  # noqa: N802 - as OpenCV calls it
        """Whether there is such a camera."""
        return self._images > 0

    def getBackendName(self) -> str:  # noqa: N802
        """Name of the driver."""
        return "V4L2"

    def set(self, what: int, value: float) -> bool:
        """Take a setting, but keep the rate."""
        if what != self._cv2.CAP_PROP_FPS:
            self._told[what] = value
        return True

    def get(self, what: int) -> float:
        """Tell a setting."""
        return self._told.get(what, 0.0)

    def grab(self) -> bool:
        """Wait for the next image; those that nobody came for are lost."""
        passed_s = time.monotonic() - _begun_s[0]
        self._number = max(self._number + 1, int(passed_s * self._fps))
        time.sleep(max(0.0, self._number / self._fps - passed_s))
        return self.isOpened()

    def retrieve(self) -> tuple[bool, Any]:
        """Return the image."""
        image = self._cv2.imread(str(self._folder / f"{self._number % self._images}.jpg"))
        return image is not None, image

    def read(self) -> tuple[bool, Any]:
        """Both."""
        return self.retrieve() if self.grab() else (False, None)

    def release(self) -> None:
        """Give it back."""


class PlugIn(importlib.abc.MetaPathFinder):
    """Plugs the cameras in when the module that opens them is loaded."""

    def find_spec(self, name: str, path: Any, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        """Return that module, which then finds other cameras."""
        if name != CAMERAS:
            return None
        found = importlib.machinery.PathFinder.find_spec(name, path)
        assert found is not None and found.loader is not None
        execute = found.loader.exec_module

        def plugged(module: Any) -> None:
            execute(module)
            module.cv2.VideoCapture = Played

        found.loader.exec_module = plugged  # type: ignore[method-assign]
        return found


if __name__ == "__main__":
    sys.executable = os.environ["PLUGGED_IN_PYTHON"]
    sys.meta_path.insert(0, PlugIn())
    script = next(argument for argument in sys.argv[1:] if argument.endswith(".py"))
    sys.argv = [script]
    runpy.run_path(script, run_name="__main__")
