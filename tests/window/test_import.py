"""Recordings of others become motion of the character: chosen, or dropped on the viewport, and nothing is asked."""

import logging
import time
from pathlib import Path

import numpy as np
from desktop import BlenderWindow, Desktop
from pointing import Hand
from sidebar_steps import check_upright, import_character, joints, opened, said_of_takes

LOG = logging.getLogger(__name__)
XBOT = "rigs/Mixamo/Xbot.glb"


def wait_for_import(desktop: Desktop, window: BlenderWindow, hand: Hand, what: str, clicks: int) -> str:
    """Wait for the end, with a picture of the way there; log the clicks and seconds."""
    begun = time.monotonic()
    state = window.wait(lambda s: s["capture"]["activity"] or s["actions"], "import")
    time.sleep(8.0)
    hand.shot(f"{what}-on-the-way")
    said = said_of_takes(window, "imported")
    LOG.info("%s: %d clicks, %.0f s: %s", what, clicks, time.monotonic() - begun, said)
    assert said.startswith("1 take imported; "), (said, state)
    hand.shot(f"{what}-done")
    return said


def test_a_c3d_is_dropped_onto_the_character_that_is_active(
    desktop: Desktop, window: BlenderWindow, shared_dir: Path
) -> None:
    hand = opened(desktop, window, "import-c3d")
    import_character(hand, shared_dir.resolve() / XBOT)
    hand.toggle("Takes")
    file = shared_dir.resolve() / "c3d/jstoecker_c3dviewer/examples/gait-pig.c3d"
    window.order("drop", paths=[str(file)])
    hand.find("Solving")  # the dialog is there
    desktop.screenshot("import-c3d-dialog")
    desktop.key("Return")
    said = wait_for_import(desktop, window, hand, "c3d", clicks=1)
    assert " on Armature; " in said or said.endswith(" on Armature"), said
    bones = {joint: bone for joint, (bone, _) in window.order("map").items() if bone}
    check_upright(window, "Armature", bones, np.arange(5.0, 60.0, 5.0))
    heights = joints(window, "Armature", np.arange(5.0, 60.0, 5.0), [bones["ltoes"], bones["rtoes"]])[..., 2]
    assert np.all(heights.min(axis=1) < 0.06)  # a foot is on the floor, its toe joint as high as in a shoe


def test_a_folder_with_the_pictures_of_both_cameras_is_chosen(
    desktop: Desktop, window: BlenderWindow, recorded: dict[str, str]
) -> None:
    hand = opened(desktop, window, "import-pictures")
    hand.toggle("Takes")
    hand.click("Import...", sidebar=True)
    folder = Path(recorded["left_folder"])
    window.wait(lambda s: s["browser"], "file browser")
    hand.shot("browser")
    hand.choose_file(folder / "180.jpg")
    wait_for_import(desktop, window, hand, "pictures", clicks=2)
    (action,) = window.state()["actions"].values()
    assert action["last"] >= 24 * 2.9  # three seconds
