"""A person without markers: the guide from two films to a character that moves, with the mouse."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from desktop import BlenderWindow, Desktop
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig, save_rig
from perfanim.core.vision.people.network_file import body_network_file
from sidebar_steps import CAPTURED, GUIDED_S, opened, press, received

CAMERAS = (0, 3)  # 108 degrees apart
ICON_PX = 49  # from the sidebar's right edge, with its tabs, to the middle of the last icon in a row


@pytest.fixture
def network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The body network in a folder of the user's; the one that Blender looks for is missing."""
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    brought = Path(shutil.copy(body_network_file(), tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return brought


@pytest.fixture
def window(network: Path, desktop: Desktop, user: Path, tmp_path: Path) -> Iterator[BlenderWindow]:
    """A freshly started Blender with an empty cache."""
    desktop.environment["XDG_CACHE_HOME"] = str(tmp_path / "cache")
    window = BlenderWindow(desktop, user, tmp_path / "observer")
    yield window
    window.close()


@pytest.fixture
def filmed(shared_dir: Path, tmp_path: Path) -> dict[str, str]:
    """Settings for two films of a man who balances on a beam, with their calibration."""
    films = shared_dir / "people" / "walk-on-beam"
    rig = load_rig(films / "Calib.qca.txt")
    save_rig(CameraRig(tuple(rig.cameras[camera] for camera in CAMERAS), rig.metadata), tmp_path / "cameras.toml")
    left, right = (shutil.copy(films / f"cam0{camera + 1}.mp4", tmp_path) for camera in CAMERAS)
    return {"left_video": left, "right_video": right, "calibration": str(tmp_path / "cameras.toml")}


def test_two_films_of_a_person_drive_a_character(
    desktop: Desktop, window: BlenderWindow, network: Path, filmed: dict[str, str]
) -> None:
    hand = opened(desktop, window, "person")
    window.order("set", values={"source": "VIDEOS", "follow": "PERSON", "capture_preview": True, **filmed})
    hand.toggle("Guide")
    hand.shot("network-missing")
    button, region = hand.find("Get Body Network", sidebar=True), window.state()["regions"]["UI"]
    desktop.click(region[0] + region[2] - ICON_PX, button.y)
    hand.choose_file(network)
    window.wait(lambda s: s["capture"]["messages"].get("cameras") == "the body network is there", "network", GUIDED_S)
    hand.shot("network-there")
    said = press(window, hand, "Check Setup", "guide")
    hand.shot("checked")
    assert said.startswith("no fault was found"), said
    hand.away()
    hand.click(
        "Skip This Step", sidebar=True
    )  # the calibration of another program knows the floor, but does not say so
    hand.shot("ready")
    hand.click("Start Capture", sidebar=True)
    window.wait(lambda s: received(s) > CAPTURED, "frames", GUIDED_S)
    hand.shot("live")
    state = window.wait(lambda s: s["capture"]["activity"] is None and s["actions"], "end of the films", GUIDED_S)
    window.wait(lambda s: not s["preview"]["shown"], "end of the preview")
    hand.find("Start Capture", sidebar=True)  # drawn again
    hand.shot("recorded")
    run = window.order("last_run")
    assert run["poses"] == run["distinct"] == 100
    assert "100 frames recorded" in state["capture"]["messages"]["capture"]
