"""A person without markers: the guide from two films to a character that moves, with the mouse."""

import shutil
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from desktop import BlenderWindow, Desktop
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig, save_rig
from perfanim.core.vision.people.network_file import body_network_file
from sidebar_steps import (
    CAPTURED,
    GUIDED_S,
    armatures,
    import_character,
    joints,
    opened,
    press,
    received,
    said_of_takes,
    use_active,
)

OWN = "Khronos_CesiumMan/CesiumMan/glTF-Binary/CesiumMan.glb"
CAMERAS = (0, 3)  # 108 degrees apart
FILMED_STD = 15.0  # least deviation of the film's grey levels; an empty viewport's is 3
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
    hand.toggle("Guide")
    hand.toggle("Takes")
    window.order("set", group="perfanim_result", values={"pictures": True})
    hand.click("Put on Character", sidebar=True)
    said = said_of_takes(window, "pictures behind")
    window.order("through", camera=said.split("pictures behind ")[1].split(", ")[0], frame=20)
    time.sleep(3.0)
    picture, view = cv2.imread(str(hand.shot("through-the-camera"))), window.state()["regions"]["WINDOW"]
    assert picture is not None
    x, y = map(round, window.from_top(view, 0.4 * view[2], 0.5 * view[3]))
    assert picture[y - 100 : y + 100, x - 60 : x + 60].std() > FILMED_STD


@pytest.mark.walkthrough
def test_cameras_are_calibrated_by_the_films_and_an_own_character_moves(
    desktop: Desktop, window: BlenderWindow, network: Path, filmed: dict[str, str], shared_dir: Path, tmp_path: Path
) -> None:
    """Without a board: the network from a wheel, the height, and six clicks; each step leaves a picture."""
    wheel = tmp_path / "wheels" / "mediapipe-0.10.14-cp311-cp311-any.whl"
    wheel.parent.mkdir()
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.write(network, f"mediapipe/modules/pose_landmark/{network.name}")
    hand = opened(desktop, window, "walking")
    import_character(hand, shared_dir.resolve() / "rigs" / OWN)
    name = use_active(hand, window, "own-character")
    films = {side: filmed[side] for side in ("left_video", "right_video")}
    window.order("set", values={"source": "VIDEOS", "follow": "PERSON", "capture_preview": True, **films})
    hand.toggle("Guide")
    button, region = hand.find("Get Body Network", sidebar=True), window.state()["regions"]["UI"]
    hand.shot("network-missing")
    desktop.click(region[0] + region[2] - ICON_PX, button.y)
    hand.choose_file(wheel)
    window.wait(lambda s: s["capture"]["messages"].get("cameras") == "the body network is there", "network", GUIDED_S)
    hand.shot("not-calibrated")
    hand.type_over("1.75", "1.72", sidebar=True)
    hand.shot("height")
    said = press(window, hand, "Calibrate by Walking", "cameras")
    hand.shot("calibrated")
    assert said.startswith("redo: ") and "the recording shows 2 s of motion" in said, said  # the films are short
    hand.away()
    hand.click("Use This Calibration", sidebar=True)
    checked = press(window, hand, "Check Setup", "guide")
    hand.shot("checked")
    assert checked.startswith("no fault was found"), checked
    hand.away()
    hand.click("Start Capture", sidebar=True)
    window.wait(lambda s: received(s) > CAPTURED, "frames", GUIDED_S)
    hand.shot("live")
    window.wait(lambda s: s["capture"]["activity"] is None and s["actions"], "end of the films", GUIDED_S)
    hand.find("Start Capture", sidebar=True)  # drawn again
    hand.shot("recorded")
    assert window.order("last_run")["poses"] == 100
    moved_m = np.ptp(joints(window, name, np.arange(1.0, 40.0, 3.0), armatures(window)[name]), axis=0)
    assert np.linalg.norm(moved_m, axis=-1).max() > 0.05
