"""`perfanim diagnose`."""

import importlib.metadata
import json
import sys

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.kernel.library import KERNEL
from perfanim.core.vision.sources import camera_source
from perfanim.core.vision.sources.camera_source import FoundCamera


def test_versions_and_cameras_are_told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_source, "find_cameras", lambda: [FoundCamera(0, (640, 480)), FoundCamera(2, None)])
    assert main(["diagnose", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    versions = {"numpy": np.__version__, "cv2": cv2.__version__}
    pure = {"pythonosc": importlib.metadata.version("python-osc"), "tomli_w": importlib.metadata.version("tomli-w")}
    assert told["libraries"] == {**versions, **pure}
    assert told["kernel"] == KERNEL.text
    assert told["cameras"] == [{"device": 0, "size": [640, 480]}, {"device": 2, "size": None}]
    assert sys.executable in told["python"]


def test_a_library_that_cannot_be_loaded_is_told_and_the_rest_as_well(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    monkeypatch.delitem(sys.modules, "perfanim.core.vision.sources.camera_source", raising=False)
    assert main(["diagnose", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["libraries"]["cv2"].startswith("cannot be loaded: ModuleNotFoundError")
    assert told["libraries"]["numpy"] == np.__version__
    assert told["cameras"] == []
