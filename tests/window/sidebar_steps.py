"""Steps of an animator's work by mouse and keyboard, for tests and for the walk of `make walks`."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from desktop import DRAWING_S, BlenderWindow, Desktop
from pointing import TRIES, Hand

CAPTURED = 30  # frames, after which a capture is on its way
GUIDED_S = 400.0  # for a button of the guide
TESTED_FRAMES = 330  # of the guide's test capture: past the T pose
START = "Start Capture"


def opened(desktop: Desktop, window: BlenderWindow, name: str) -> Hand:
    """Open the tab, delete the cube and close the Capture panel."""
    window.open_tab("Perfanim")
    hand = Hand(desktop, window, name)
    hand.away()
    for key in ("x", "Return"):  # asked and answered
        desktop.key(key)
        time.sleep(0.7)
    hand.toggle("Capture")
    return hand


def import_character(hand: Hand, path: Path) -> None:
    """File > Import > glTF."""
    hand.menu("File", "Import", "glTF 2.0 (.glb/.gltf)")
    hand.choose_file(path)


def use_active(hand: Hand, window: BlenderWindow, picture: str) -> str:
    """Let the character that is active move along; return its armature's name."""
    hand.toggle("Character")
    before = window.state()["armature"]
    hand.click("Use Active", sidebar=True)
    name = window.wait(lambda s: s["armature"] not in ("", before), "a chosen armature")["armature"]
    hand.shot(picture)
    hand.toggle("Character")
    return str(name)


def record(hand: Hand, window: BlenderWindow, picture: str, by_button: bool = False) -> None:
    """Start Capture, wait for some frames, Stop Capture; with Record and Stop Recording between, rehearsed before."""
    before = len(window.state()["actions"])
    begin(window, hand, START)
    wait_for_frames(window, 0)
    if by_button:
        begin(window, hand, "Record", lambda s: bool(s["capture"].get("recording")))
        wait_for_frames(window, received(window.state()))
        hand.shot(picture)
        hand.click("Stop Recording", sidebar=True)
    else:
        hand.shot(picture)
    hand.click("Stop Capture", sidebar=True)
    window.wait(lambda s: s["capture"]["activity"] is None and len(s["actions"]) > before, "end of the capture")


def wait_for_frames(window: BlenderWindow, before: int) -> None:
    window.wait(lambda s: received(s) > before + CAPTURED, "frames")


def received(state: dict[str, Any]) -> int:
    return int(state["capture"].get("statistics", {}).get("received", 0))


def said_of_takes(window: BlenderWindow, word: str, key: str = "takes") -> str:
    """Wait until the Takes panel says something with a word in it, and no work is going on.

    Args:
        key: of the message: "import" for that of an import.
    """

    def said(state: dict[str, Any]) -> bool:
        return state["capture"]["activity"] is None and word in str(state["capture"]["messages"].get(key))

    return str(window.wait(said, f"{word!r} in the Takes panel")["capture"]["messages"][key])


def is_busy(state: dict[str, Any]) -> bool:
    return bool(state["capture"]["activity"])


def begin(
    window: BlenderWindow, hand: Hand, button: str, has_begun: Callable[[dict[str, Any]], bool] = is_busy
) -> None:
    """Click on a button until its work has begun: a busy machine loses clicks."""
    for _ in range(TRIES):
        hand.away()
        hand.click(button, sidebar=True)
        limit = time.monotonic() + DRAWING_S / 3.0
        while time.monotonic() < limit:
            if has_begun(window.state()):
                return
            time.sleep(0.2)
    raise AssertionError(f"{button}: {hand.shot('not-begun')}")


def press(window: BlenderWindow, hand: Hand, button: str, panel: str) -> str:
    """Click on the guide's button, wait for the end of its work, and return what the panel says."""
    begin(window, hand, button)
    return ended(window, button, panel)


def ended(window: BlenderWindow, button: str, panel: str) -> str:
    """Wait for the end of a button's work, and return what the panel says."""
    state = window.wait(lambda s: s["capture"]["activity"] is None, f"end of {button}", GUIDED_S)
    return str(state["capture"]["messages"].get(panel))


def follow_guide(window: BlenderWindow, hand: Hand) -> Iterator[tuple[str, Path]]:
    """Go through the guide on simulated cameras, and yield each step's name and a picture of it."""
    hand.toggle("Guide")
    yield "cameras", hand.shot("cameras")
    hand.click("Practise Calibration", sidebar=True, lowest=True)  # the sentence above names it, too
    window.order("set", values={"practise_fault": "REFLECTION", "behaviour": "walking"})
    yield "exposure", hand.shot("exposure")
    press(window, hand, "Check Setup", "guide")
    assert window.state()["preview"]["shown"]
    yield "reflection", hand.shot("reflection")
    window.order("set", values={"practise_fault": "NONE"})
    assert press(window, hand, "Check Setup", "guide") == "no fault was found"
    yield "calibrate", hand.shot("calibrate")
    begin(window, hand, "Calibrate with Board")
    window.wait(lambda s: s["preview"]["shown"] and s["capture"]["heading"] > "0 views", "a view")
    yield "board", hand.shot("board")
    assert ended(window, "Calibrate with Board", "cameras").startswith("good")
    yield "floor", hand.shot("floor")
    assert press(window, hand, "Set Floor from Board", "cameras").startswith("floor set")
    yield "markers", hand.shot("markers")
    said = press(window, hand, "Check Setup", "guide")
    assert said.startswith("no fault was found; you may walk"), said
    yield "performer", hand.shot("performer")
    assert "residual" in press(window, hand, "Calibrate Performer", "subject")
    yield "ready", hand.shot("ready")
    hand.click(START, sidebar=True)
    wait_for_frames(window, TESTED_FRAMES)
    yield "live", hand.shot("live")
    hand.click("Stop Capture", sidebar=True)
    state = window.wait(lambda s: s["capture"]["activity"] is None, "end")
    yield "walk test", hand.shot("walk-test")
    assert state["capture"]["walk"].startswith("captures will be "), state["capture"]


def armatures(window: BlenderWindow) -> dict[str, list[str]]:
    """Return the names of all armatures with those of their bones."""
    return dict(window.order("armatures"))


def joints(window: BlenderWindow, name: str, frames: np.ndarray, bones: list[str]) -> np.ndarray:
    """Return where the bones (F, B, 3) of an object are in the scene."""
    return np.array(window.order("joints", object=name, frames=frames.tolist(), bones=bones)["joints"])


def check_walk(window: BlenderWindow, name: str, bones: dict[str, str]) -> None:
    """The performer walks to the cameras and back on the floor."""
    at, leg = check_upright(window, name, bones, np.arange(1.0, 350.0, 3.0))
    ankles = np.stack([at["lfoot"][:, 2], at["rfoot"][:, 2]])
    assert 0.0 < ankles.min() < 0.25 * leg  # neither under the floor nor over it
    assert np.median(ankles.min(axis=0)) < 0.25 * leg
    assert np.ptp(at["root"][:, 1]) > 2.0 * leg


def check_upright(
    window: BlenderWindow, name: str, bones: dict[str, str], frames: np.ndarray
) -> tuple[dict[str, np.ndarray], float]:
    """The character is upright, its legs keep their length; knees bend forward, elbows backward.

    Returns:
        Where the joints (F, 3) are, and the length of a leg.
    """
    wanted = ["root", "head"] + [
        side + joint for side in "lr" for joint in ("femur", "tibia", "foot", "humerus", "radius", "hand")
    ]
    found = joints(window, name, frames, [bones[joint] for joint in wanted])
    at = {joint: found[:, index] for index, joint in enumerate(wanted)}
    legs = np.linalg.norm(at["lfemur"] - at["ltibia"], axis=-1) + np.linalg.norm(at["ltibia"] - at["lfoot"], axis=-1)
    assert np.ptp(legs) < 1e-3
    up = at["head"] - at["root"]
    assert np.all(up[:, 2] > 0.95 * np.linalg.norm(up, axis=-1))
    left = at["lfemur"] - at["rfemur"]
    front = np.cross(left, [0.0, 0.0, 1.0])
    front /= np.linalg.norm(front, axis=-1, keepdims=True)
    for side in "lr":
        for upper, middle, lower, sign in (("femur", "tibia", "foot", 1.0), ("humerus", "radius", "hand", -1.0)):
            bend = at[side + middle] - 0.5 * (at[side + upper] + at[side + lower])
            assert np.median(sign * np.sum(bend * front, axis=-1)) > 0.0, side + middle
    return at, float(np.mean(legs))
