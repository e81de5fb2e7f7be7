"""Recordings of others become motion of the character: chosen, or dropped on the viewport, and nothing is asked."""

import logging
import shutil
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from desktop import BlenderWindow, Desktop
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.c3d_write import write_c3d
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.simulate.studio.video import write_video
from perfanim.core.system.assets import MOTION
from pointing import Hand
from sidebar_steps import check_upright, import_character, joints, opened, said_of_takes

LONGEST_S = 500.0
LOG = logging.getLogger(__name__)
XBOT = "rigs/Mixamo/Xbot.glb"


def wait_for_import(desktop: Desktop, window: BlenderWindow, hand: Hand, what: str, clicks: int) -> str:
    """Wait for the end, with a picture of the way there; log the clicks and seconds."""
    begun = time.monotonic()
    state = window.wait(lambda s: s["capture"]["activity"] or s["actions"], "import")
    time.sleep(8.0)
    hand.shot(f"{what}-on-the-way")
    window.wait(lambda s: s["capture"]["activity"] is None, "end of the import", LONGEST_S)
    said = said_of_takes(window, "imported", "import")
    LOG.info("%s: %d clicks, %.0f s: %s", what, clicks, time.monotonic() - begun, said)
    assert said.startswith("1 take imported; "), (said, state)
    hand.shot(f"{what}-done")
    return said


def test_a_c3d_is_dropped_onto_the_character_that_is_active(
    desktop: Desktop, window: BlenderWindow, shared_dir: Path, tmp_path: Path
) -> None:
    walk = tmp_path / "walk.trc"
    line = ["simulate", "markers", str(MOTION / "walking-01-neutral.bvh"), "--marker-set", "plug-in-gait"]
    assert main([*line, "--fps", "30", "--out", str(walk)]) == 0
    file = tmp_path / "walk.c3d"
    write_c3d(read_take(walk), file)
    hand = opened(desktop, window, "import-c3d")
    import_character(hand, shared_dir.resolve() / XBOT)
    hand.toggle("Takes")
    window.order("drop", paths=[str(file)])
    hand.find("Solving")  # the dialog is there
    desktop.screenshot("import-c3d-dialog")
    desktop.key("Return")
    said = wait_for_import(desktop, window, hand, "c3d", clicks=1)
    assert " on XBOT" in said, said
    bones = {joint: bone for joint, (bone, _) in window.order("map").items() if bone}
    check_upright(window, "XBOT", bones, np.arange(5.0, 60.0, 5.0))
    heights = joints(window, "XBOT", np.arange(5.0, 60.0, 5.0), [bones["ltoes"], bones["rtoes"]])[..., 2]
    assert np.all(heights.min(axis=1) < 0.06)  # a foot is on the floor, its toe joint as high as in a shoe


@pytest.mark.walkthrough
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


@pytest.mark.walkthrough
def test_two_films_are_dropped_onto_the_character_that_is_active(
    desktop: Desktop, window: BlenderWindow, recorded: dict[str, str], shared_dir: Path, tmp_path: Path
) -> None:
    """Blender would also take films as reference pictures, so it asks which of the two is meant."""
    films = []
    for side in ("left", "right"):
        pictures = [cv2.imread(str(Path(recorded[f"{side}_folder"]) / f"{number}.jpg")) for number in range(180, 360)]
        films.append(tmp_path / f"{side}.mp4")
        write_video(films[-1], pictures, 60.0)
    shutil.copy(recorded["calibration"], tmp_path)
    hand = opened(desktop, window, "import-films")
    import_character(hand, shared_dir.resolve() / XBOT)
    hand.toggle("Takes")
    window.order("set", group="perfanim_result", values={"pictures": True})
    window.order("drop", paths=list(map(str, films)))
    hand.shot("which-of-the-two")
    hand.click("Import Motion")
    hand.find("Solving")
    desktop.screenshot("import-films-dialog")
    desktop.key("Return")
    said = wait_for_import(desktop, window, hand, "films", clicks=2)
    assert " on XBOT" in said, said
    bones = {joint: bone for joint, (bone, _) in window.order("map").items() if bone}
    check_upright(window, "XBOT", bones, np.arange(5.0, 60.0, 5.0))
    (action,) = [action for name, action in window.state()["actions"].items() if f" in {name} on" in said]
    assert action["last"] >= 24 * 2.9  # three seconds
    window.order("through", camera=said.split("pictures behind ")[1].split(", ")[0], frame=40)
    time.sleep(5.0)
    hand.shot("through-the-camera")
