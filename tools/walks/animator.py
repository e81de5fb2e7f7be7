"""Animator: the zip to a moving character of one's own.

It is moved by the guide's simulated cameras, and by recorded pictures.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "window"))

import numpy as np
from desktop import BlenderWindow, Desktop, blender_python, build_archive
from pointing import Hand
from recordings import SIDES, SQUARE_MM, record_board, record_walk
from sidebar_steps import (
    START,
    check_upright,
    follow_guide,
    import_character,
    opened,
    use_active,
    wait_for_frames,
)

from .page import ROOT, Walk, WalkError

_MOST_CLICKS, _MOST_S = 3, 60.0  # from Install from Disk to a moving character
_SCREEN = (1400, 900)
_ARROW_PX = 71  # from the word Repositories to the arrow right of it
_FIELD_PX = 130  # from a setting's name to its field
_ROW_PX = 31  # from a panel's heading to its first field
_LIVE_FRAMES = 90  # of recorded pictures
_SEEN = (0.6, 0.9)  # of the character's motion, on pictures
_LEAST_MOVED = 0.1  # of a leg, by a hand
_WEBCAM_PICTURES = "1[78]*"  # of the fourth sequence: six seconds, several steps away from the cameras


@dataclass(frozen=True)
class _Recording:
    """Pictures of two cameras.

    Args:
        patterns: of their files.
        calibrating: words of `calibrate cameras`.
        height_m: of the performer.
    """

    patterns: tuple[str, str]
    calibrating: tuple[str | Path, ...]
    marker_set: str
    height_m: float

    @property
    def marker_label(self) -> str:
        """The marker set's name as the sidebar shows it."""
        return self.marker_set.replace("-", " ").title()


def walk_through(folder: Path, webcams: Path | None = None, character: Path | None = None) -> None:
    """Go through the README, the guide, and image pairs in docs/marker-takes.md.

    Args:
        webcams: a folder with `sequence4`, pairs of pictures `*_1.jpg` and `*_2.jpg`, and the board points
            `stereo_calibration.json`; pictures of the simulated studio by default.
        character: a glTF file; one with Mixamo's names by default.

    Raises:
        WalkError: a step did not end as the documents say.
    """
    user = folder / "user"  # an empty home
    walk = Walk("Animator: the zip to a moving character", folder, {"BLENDER_USER_RESOURCES": str(user)})
    user.mkdir()
    desktop = Desktop(os.environ["BLENDER"], folder / "screens", _SCREEN)
    try:
        with _blender(desktop, user) as window:
            _install(walk, desktop, window)
            _first_character(walk, desktop, window)
        hero = character or _own_character(walk)
        with _blender(desktop, user) as window:
            _guide(walk, desktop, window, hero)
        recording = _webcams(webcams) if webcams else _simulated(folder / "film")
        _prepare(walk, desktop, recording)
        with _blender(desktop, user) as window:
            _recorded(walk, desktop, window, recording, hero)
    except (AssertionError, subprocess.SubprocessError) as error:
        raise WalkError(str(error)) from error
    finally:
        desktop.close()


@contextmanager
def _blender(desktop: Desktop, user: Path) -> Iterator[BlenderWindow]:
    window = BlenderWindow(desktop, user, user.parent / "observer")
    try:
        yield window
        window.order("quit")  # which saves the preferences
        window.wait_for_end()
    finally:
        window.close()
        window.forget()


def _install(walk: Walk, desktop: Desktop, window: BlenderWindow) -> None:
    """Install from Disk, by the Preferences."""
    archive = build_archive(blender_python(desktop.wrapper))
    walk.step("A new Blender", f"Nothing is set, nothing installed. The zip is {archive.name}.")
    hand = Hand(desktop, window, "install")
    walk.show([hand.shot("new")])
    desktop.key("Escape")
    walk.step("Install from Disk", "Edit > Preferences > Get Extensions, the arrow at the top right.")
    time.sleep(1.0)
    hand.menu("Edit", "Preferences...")
    desktop.bring_in("Preferences")
    hand.click("Get Extensions")
    hand.click("Repositories", beside=_ARROW_PX)
    time.sleep(1.0)
    walk.show([desktop.screenshot("menu")])  # which closes when the pointer leaves it
    hand.click("Install from Disk...")
    window.wait(lambda s: s["browser"], "file browser")
    desktop.bring_in("File View")
    walk.show([desktop.screenshot("file")])
    hand.choose_file(archive)


def _first_character(walk: Walk, desktop: Desktop, window: BlenderWindow) -> None:
    """Close the Preferences, N, the tab, Start Capture: count clicks and seconds."""
    begun_s = time.monotonic()
    walk.step("The first moving character", "Close the Preferences, N, the tab, Start Capture.")
    window.wait(lambda s: s["capture"]["registered"], "the extension")
    walk.show([desktop.screenshot("installed")])
    desktop.put_away("Preferences")
    window.open_tab("Perfanim")  # it tries the tabs; a person clicks on one
    walk.show([desktop.screenshot("tab")])
    clicks = ("close the Preferences", "the tab", START)
    desktop.click(*window.tall_button("start"))
    wait_for_frames(window, 0)  # the first ones may not be drawn yet
    seconds = time.monotonic() - begun_s
    walk.show([desktop.screenshot("moving")])
    walk.note(f"{len(clicks)} clicks ({', '.join(clicks)}) and the key N, {seconds:.0f} s after Install from Disk")
    if len(clicks) > _MOST_CLICKS or seconds > _MOST_S:
        raise WalkError(f"more than {_MOST_CLICKS} clicks or {_MOST_S:.0f} s")
    _stop(walk, desktop, window)


def _stop(walk: Walk, desktop: Desktop, window: BlenderWindow) -> None:
    desktop.click(*window.tall_button("stop"))
    window.wait(lambda s: s["capture"]["activity"] is None, "end")
    time.sleep(1.0)
    walk.show([desktop.screenshot("stopped")])


def _own_character(walk: Walk) -> Path:
    """Make a character of one's own."""
    hero = walk.folder / "hero.glb"
    walk.step("A character of one's own", "A glTF file with the bones' names of Mixamo.")
    walk.run("python", "-m", "walks.own_character", hero, at=ROOT / "tools")
    return hero


def _guide(walk: Walk, desktop: Desktop, window: BlenderWindow, hero: Path) -> None:
    """Import the character, choose it, follow the guide on simulated cameras."""
    walk.step("Import it and click Use Active")
    hand = opened(desktop, window, "guide")
    import_character(hand, hero)
    name = use_active(hand, window, "bones")
    walk.show([hand.shot("own")])
    walk.step("The guide, on simulated cameras", "One step at a time, with a reflection to find.")
    for step, picture in follow_guide(window, hand):
        walk.note(step)
        walk.show([picture])
    _judge(walk, window, hand, name)


def _judge(walk: Walk, window: BlenderWindow, hand: Hand, name: str) -> None:
    """Show the character's motion, and stop where it does not move or is wrung."""
    bones = {joint: bone for joint, (bone, _) in window.order("map").items() if bone}
    action = max(window.state()["actions"].values(), key=lambda facts: facts["keys_max"])
    last = int(action["last"])
    walk.note(f"{action['keys_max']} keyframes on {name} up to frame {last}, {len(bones)} joints mapped")
    for share in _SEEN:
        frame = round(share * last)
        window.order("look", frame=frame, around_deg=25.0)
        walk.show([hand.shot(f"frame-{frame}")])
    at, leg = check_upright(window, name, bones, np.arange(1.0, last))
    moved = float(np.max(np.ptp(at["lhand"] - at["root"], axis=0)))
    walk.note(f"the left hand moves by {moved / leg:.2f} of a leg's length about the hips")
    if moved < _LEAST_MOVED * leg:
        raise WalkError(f"{name} does not move")


def _webcams(folder: Path) -> _Recording:
    """Return a part of the pictures of two webcams, both in one folder."""
    pictures = folder / "sequence4"
    if not pictures.is_dir():
        raise WalkError(f"{folder}: it has no folder sequence4")
    patterns = (str(pictures / f"{_WEBCAM_PICTURES}_1.jpg"), str(pictures / f"{_WEBCAM_PICTURES}_2.jpg"))
    return _Recording(patterns, ("--points", folder / "stereo_calibration.json"), "two-webcams", 1.6)


def _simulated(folder: Path) -> _Recording:
    """Return pictures of the simulated studio, a folder for each camera."""
    source = record_walk(folder / "walk", 6.0, range(240, 480))
    record_board(folder / "board", source.renderer, count=12)
    left, right = (str(folder / "board" / side) for side in SIDES)
    board = ("--left", left, "--right", right, "--board", f"chessboard:9x6:{SQUARE_MM:g}mm")
    patterns = (str(folder / "walk" / SIDES[0]), str(folder / "walk" / SIDES[1]))
    return _Recording(patterns, board, source.subject.marker_set.name, 1.75)


def _prepare(walk: Walk, desktop: Desktop, recording: _Recording) -> None:
    """Calibrate cameras, floor and performer by Blender's command line."""

    def run(*words: str | Path) -> None:
        walk.run(desktop.wrapper, "blender", "--background", "--command", "perfanim", *words)

    walk.step("Pictures of two cameras", "docs/marker-takes.md, From image pairs, with Blender's own command line.")
    worn = ("--marker-set", recording.marker_set)
    left, right = recording.patterns
    run("calibrate", "cameras", *recording.calibrating, "--out", "cameras.toml")
    run(
        *("track", "--cameras", "cameras.toml", "--left", left, "--right", right, *worn),
        *("--floor", "feet", "--floor-cameras", "level.toml", "--out", "walk.take.npz"),
    )
    database = next((walk.folder / "user").rglob("starter.pfdb"))
    size = ("--height", str(recording.height_m))
    run("calibrate", "subject", "walk.take.npz", *worn, "--database", database, *size, "--out", "anna.toml")


def _recorded(walk: Walk, desktop: Desktop, window: BlenderWindow, recording: _Recording, hero: Path) -> None:
    """Choose pictures, markers, performer and character, and capture."""
    walk.step("The pictures in the sidebar", "Source Image Folders, calibration, marker set, performer.")
    hand = opened(desktop, window, "pictures")
    import_character(hand, hero)
    hand.toggle("Cameras")
    hand.click("Simulated Performer", sidebar=True)
    hand.click("Image Folders")
    _fill(hand, "Left", recording.patterns[0])
    _fill(hand, "Right", recording.patterns[1])
    _fill(hand, "Calibration", str(walk.folder / "level.toml"))
    walk.show([hand.shot("cameras")])
    hand.toggle("Cameras")
    hand.toggle("Markers")
    if recording.marker_label != "Boxing":
        hand.click("Boxing", sidebar=True)
        hand.click(recording.marker_label)
    walk.show([hand.shot("markers")])
    hand.toggle("Markers")
    hand.toggle("Subject")
    _fill(hand, "Subject", str(walk.folder / "anna.toml"), below=_ROW_PX)  # its heading has the name, too
    walk.show([hand.shot("subject")])
    hand.toggle("Subject")
    name = use_active(hand, window, "bones")
    hand.toggle("Capture")
    walk.show([hand.shot("ready")])
    walk.step("Start Capture")
    hand.click(START, sidebar=True)
    wait_for_frames(window, _LIVE_FRAMES)
    walk.show([hand.shot("live")])
    if window.state()["capture"]["activity"] is not None:  # the pictures may have ended
        hand.click("Stop Capture", sidebar=True)
    window.wait(_ended, "end of the capture")
    walk.show([hand.shot("stopped")])
    _judge(walk, window, hand, name)


def _ended(state: dict[str, Any]) -> bool:
    return state["capture"]["activity"] is None and bool(state["actions"])


def _fill(hand: Hand, name: str, text: str, below: float = 0.0) -> None:
    hand.type_over(name, text, beside=_FIELD_PX, sidebar=True, below=below)
