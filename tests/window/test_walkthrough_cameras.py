"""What stands before the cameras besides the performer, by mouse and keyboard: a prop, boards, markers on the floor.

Every step leaves a picture in out/window: `make window-test MARK=walkthrough`.
"""

import json
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from desktop import DRAWING_S, BlenderWindow, Desktop
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.subject import save_subject
from perfanim.core.simulate.studio.boards import CarriedBoard, board_poses
from perfanim.core.simulate.studio.floor_marker_source import FloorMarkers
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.calibration.calibration_board import parse_board
from pointing import Hand
from sidebar_steps import begin, opened, received, wait_for_frames
from test_walkthrough import desktop  # noqa: F401 - the fixture

pytestmark = pytest.mark.walkthrough

ADD_PX = (163, 30)  # from the words Additional Targets to +
TRIES = 4
FIELD_PX = 120  # from a setting's name to its value
BOARD = "charuco:7x5:120mm:90mm:DICT_4X4_50"
PLACES, BOARD_FPS = 30, 6.0  # in which the board is held, and images of a camera in a second
ENOUGH_VIEWS = 20
EMPTY_S, SHOWN_S, FPS = 8.0, 16.0, 20.0
CAMERAS = 3


@contextmanager
def holding(desktop: Desktop, key: str) -> Iterator[None]:  # noqa: F811
    """Keep a key down."""
    desktop.run("xdotool", "keydown", key)
    try:
        yield
    finally:
        desktop.run("xdotool", "keyup", key)


def choose(window: BlenderWindow, hand: Hand, setting: tuple[str, str], shown: tuple[str, str]) -> None:
    """Choose another entry of a menu, again where a busy machine has lost a click.

    Args:
        setting: its name and the value wanted.
        shown: what the menu shows before and after.
    """
    for _ in range(TRIES):
        hand.away()
        hand.click(shown[0], sidebar=True)
        hand.click(shown[1], lowest=True)
        if window.order("get", name=setting[0])["value"] == setting[1]:
            return
        hand.escape()
    raise AssertionError(f"{setting}: {hand.shot('not-chosen')}")


def enter(window: BlenderWindow, hand: Hand, setting: str, text: str, name: str) -> None:
    """Type a setting's value, again where a busy machine has not taken two clicks for a double click."""
    for _ in range(TRIES):
        hand.away()
        hand.type_over(setting, text, beside=FIELD_PX, sidebar=True)
        value = window.order("get", name=name)["value"]
        if value == type(value)(text):
            return
        hand.escape()
    raise AssertionError(f"{setting}: {value}")


def add_target(desktop: Desktop, hand: Hand, below: str) -> None:  # noqa: F811
    """Open Additional Targets and click on +; `below` is the next panel's name."""
    before = hand.find(below, sidebar=True)
    place = hand.find("Additional Targets", sidebar=True)
    desktop.click(place.x, place.y)
    limit = time.monotonic() + DRAWING_S
    while hand.find(below, sidebar=True).y < before.y + ADD_PX[1]:
        assert time.monotonic() < limit, hand.shot("closed")
    desktop.click(place.x + ADD_PX[0], place.y + ADD_PX[1])
    hand.find("Definition", sidebar=True)


def test_a_sword_is_followed(desktop: Desktop, window: BlenderWindow) -> None:  # noqa: F811
    hand = opened(desktop, window, "prop")
    hand.toggle("Cameras")
    choose(window, hand, ("behaviour", "kendo"), ("Everything", "Kendo"))
    hand.shot("performs")
    hand.toggle("Cameras")
    add_target(desktop, hand, "Takes")
    hand.shot("added")
    hand.toggle("Capture")
    for shown in ("Markers", "Skeleton"):
        with holding(desktop, "shift"):
            hand.click(shown, sidebar=True, lowest=True)
    hand.shot("drawn")
    begin(window, hand, "Start Capture")
    wait_for_frames(window, 0)
    hand.shot("live")
    wait_for_frames(window, received(window.state()) + 60)
    hand.shot("stroke")
    hand.click("Stop Capture", sidebar=True)
    ended = window.wait(lambda s: s["capture"]["activity"] is None, "end")
    assert "Capture sword" in ended["actions"]
    hand.shot("stopped")


@pytest.fixture(scope="module")
def plugged_in(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of what three cameras show of a board, of markers on the floor, and of a performer with a sword."""
    folder = tmp_path_factory.mktemp("plugged-in")
    rig = default_rig(CAMERAS)
    board = parse_board(BOARD)
    carried = CarriedBoard(Renderer(rig), board, board_poses(rig, board, PLACES))
    play(folder / "board", BOARD_FPS, (image_set.images for image_set in carried))
    markers = FloorMarkers(rig)
    lying = (frame.images for frame in islice(markers, 0, None, round(markers.fps / FPS)))
    play(folder / "floor", FPS, chain(markers.background_frames(round(EMPTY_S * FPS)), lying))
    spec = {"behaviour": "kendo", "prop": "sword", "cameras": CAMERAS, "fps": FPS, "seconds": SHOWN_S, "poses": ["t"]}
    performer = open_simulated(spec)
    shown = (frame.images for frame in performer)
    play(folder / "performer", FPS, chain(performer.background_frames(round(EMPTY_S * FPS)), shown))
    save_subject(performer.subject, folder / "subject.toml")
    python = folder / "python"
    python.write_text(
        f"#!/bin/sh\nPLUGGED_IN={folder} PLUGGED_IN_PYTHON=$0 exec python3 {Path(__file__).with_name('plugged_in.py')} "
        '"$@"\n'
    )
    python.chmod(0o755)
    return folder


def play(folder: Path, fps: float, moments: Iterable[Sequence[np.ndarray]]) -> None:
    """Keep images of moments, one per camera, as `plugged_in.py` plays them."""
    folder.mkdir()
    (folder / "fps").write_text(f"{fps:g}")
    for number, images in enumerate(moments):
        for device, image in enumerate(images):
            (folder / str(device)).mkdir(exist_ok=True)
            assert cv2.imwrite(str(folder / str(device) / f"{number}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 97])


def put_before_the_cameras(folder: Path, scene: str) -> None:
    """Let the cameras show another scene when they are opened the next time."""
    fps = float((folder / scene / "fps").read_text())
    (folder / "scene.json").write_text(json.dumps({"scene": scene, "fps": fps}))


def views(state: dict[str, Any]) -> int:
    """How many views of the board were taken."""
    taken = str(state["capture"]["heading"]).partition(" view")[0]
    return int(taken) if taken.isdigit() else 0


def told(window: BlenderWindow, panel: str) -> str:
    """Wait for the end of the work that goes on, and return what its panel says."""
    ended = window.wait(lambda s: s["capture"]["activity"] is None, "end", 400.0)
    return str(ended["capture"]["messages"].get(panel))


def test_three_cameras_are_calibrated_by_charuco_board_and_floor_markers_and_follow_a_sword(
    desktop: Desktop,  # noqa: F811
    window: BlenderWindow,
    plugged_in: Path,
) -> None:
    window.order("preference", name="worker_python", value=str(plugged_in / "python"))
    hand = opened(desktop, window, "three-cameras")
    hand.toggle("Cameras")
    choose(window, hand, ("source", "CAMERAS"), ("Simulated Performer", "Cameras"))
    choose(window, hand, ("board_kind", "CHARUCO"), ("Chessboard", "ChArUco"))
    for setting, text, name in (
        ("Additional", "2", "further_devices"),
        ("Columns", "7", "board_columns"),
        ("Rows", "5", "board_rows"),
        ("Square (mm)", "120", "board_square_mm"),
        ("Marker (mm)", "90", "board_code_mm"),
    ):
        enter(window, hand, setting, text, name)
    hand.shot("settings")
    put_before_the_cameras(plugged_in, "board")
    begin(window, hand, "Calibrate with Board")
    window.wait(lambda s: views(s) >= 4, "views")
    hand.shot("board")
    window.wait(lambda s: views(s) >= ENOUGH_VIEWS, "enough views", 600.0)
    hand.click("Finish Now", sidebar=True)
    said = told(window, "cameras")
    hand.shot("calibrated")
    assert said.startswith(("good", "usable")), said
    put_before_the_cameras(plugged_in, "floor")
    begin(window, hand, "Set Floor from Markers")
    window.wait(lambda s: s["preview"]["shown"], "a preview")
    desktop.screenshot("three-cameras-floor")  # it is soon over
    said = told(window, "cameras")
    hand.shot("on-floor")
    assert said.startswith("floor set at the 4 markers"), said
    rig = load_rig(window.order("get", name="calibration")["value"])
    for found, true in zip(rig.cameras, default_rig(CAMERAS).cameras, strict=True):
        across = np.linalg.norm((found.centre_m - true.centre_m)[[1]])
        assert across < 0.03, (found.centre_m, true.centre_m)

    hand.toggle("Cameras")
    window.order("set", values={"subject": str(plugged_in / "subject.toml"), "capture_preview": True})
    add_target(desktop, hand, "Takes")
    hand.toggle("Capture")
    hand.click("Markers", sidebar=True, lowest=True)
    put_before_the_cameras(plugged_in, "performer")
    begin(window, hand, "Start Capture")
    wait_for_frames(window, 60)
    hand.shot("live")
    wait_for_frames(window, 150)
    hand.shot("stroke")
    hand.click("Stop Capture", sidebar=True)
    ended = window.wait(lambda s: s["capture"]["activity"] is None, "end")
    hand.shot("stopped")
    confidence = window.order("last_run")["confidence"]
    assert sorted(confidence)[len(confidence) // 2] > 0.5
    assert "Capture sword" in ended["actions"]
    for word in ("Traceback", "Exception", "Error:"):
        assert word not in window.log(), window.log()[-3000:]
