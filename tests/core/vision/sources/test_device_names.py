"""Names of cameras on each system."""

from pathlib import Path

import pytest
from perfanim.core.vision.sources import device_names
from perfanim.core.vision.sources.device_names import device_name, device_numbers


@pytest.fixture
def listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(device_names, "_LISTED", tmp_path)
    return tmp_path


def put(listed: Path, device: int, name: bytes) -> None:
    (listed / f"video{device}").mkdir()
    (listed / f"video{device}" / "name").write_bytes(name)


def test_names_of_devices_on_linux(listed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_names.sys, "platform", "linux")
    put(listed, 0, b"HD Webcam C525\n")
    put(listed, 2, b"Bad \xff\x07 name " + 100 * b"x")
    put(listed, 3, b"\n")
    assert device_name(0) == "HD Webcam C525 (0)"
    assert device_name(1) == "Camera 1"  # unplugged
    assert device_name(2).startswith("Bad ") and len(device_name(2)) < 70 and device_name(2).isprintable()
    assert device_name(3) == "Camera 3"


@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_cameras_are_numbered_on_other_systems(listed: Path, monkeypatch: pytest.MonkeyPatch, system: str) -> None:
    monkeypatch.setattr(device_names.sys, "platform", system)
    put(listed, 0, b"HD Webcam C525\n")
    assert device_name(0) == "Camera 0"
    assert device_numbers() == list(range(8))
