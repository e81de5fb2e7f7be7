"""An animator's work by mouse and keyboard: captures, takes, characters of others, files for other programs.

Every step leaves a picture in out/window. The way over all kinds of characters takes minutes: `make
window-walkthrough`.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from desktop import ROOT, BlenderWindow, Desktop
from perfanim.core.retarget.bone_map import EXPECTED
from pointing import Hand
from sidebar_steps import (
    CAPTURED,
    armatures,
    check_walk,
    import_character,
    joints,
    opened,
    record,
    said_of_takes,
    use_active,
)

EXPORTED_MM = 1.0
FRAMES = 443  # of the take of two webcams
WEBCAMS_HZ = 30  # of files written of it: the mean rate of its time stamps is 29.2
SCENE_FPS = 24.0
TRASH_PX = 76  # from the word Export to the icon
FIELD_PX = 120  # from a setting's name in a dialog to its value
VRM = "VRM-Addon-for-Blender/tests/resources/unity/VrmaInspector/Assets/StreamingAssets/Example.vrm"
CHARACTERS = {
    "xbot": "Mixamo/Xbot.glb",
    "mannequiny": "Godot_mannequiny/ragdoll_physics/characters/mannequiny.glb",
    "cesium-man": "Khronos_CesiumMan/CesiumMan/glTF-Binary/CesiumMan.glb",
    "vrm": VRM,
    "rigify": "",  # generated in Blender from its own metarig
}


@pytest.fixture
def desktop(wrapper: str) -> Iterator[Desktop]:
    """A screen on which all panels of the work have room."""
    desktop = Desktop(wrapper, ROOT / "out" / "window", (1400, 900))
    yield desktop
    desktop.close()


def actions(window: BlenderWindow) -> list[str]:
    return sorted(window.state()["actions"])


def test_captures_are_solved_again_deleted_undone_and_exported(
    desktop: Desktop, window: BlenderWindow, tmp_path: Path
) -> None:
    hand = opened(desktop, window, "walkthrough")
    # exports have the recorded rate, so the keys must, too
    window.order("set", group="perfanim_result", values={"whole_frames": False})
    hand.toggle("Capture")
    record(hand, window, "first-capture")
    (capture,) = actions(window)
    performer = window.state()["armature"]
    hand.click("Record by Button", sidebar=True)
    record(hand, window, "second-capture", by_button=True)
    before = actions(window)
    assert len(before) == 2

    hand.toggle("Capture")
    hand.toggle("Takes")
    hand.shot("takes")
    hand.click("Solve Again", sidebar=True)
    hand.click("Method", beside=FIELD_PX)
    hand.click("nearest")
    desktop.screenshot("walkthrough-dialog")
    desktop.key("Return")
    assert said_of_takes(window, "(nearest)")
    hand.shot("solved-again")
    after = actions(window)
    assert len(after) == 3
    for key, wanted in (("ctrl+z", before), ("ctrl+z", [capture]), ("ctrl+shift+z", before), ("ctrl+shift+z", after)):
        hand.away()
        desktop.key(key)
        window.wait(lambda s, wanted=wanted: sorted(s["actions"]) == wanted, f"{key}: {wanted}")
    hand.shot("redone")

    hand.click("Export", sidebar=True, beside=TRASH_PX)
    assert "(nearest) deleted" in said_of_takes(window, "deleted")
    hand.shot("deleted")
    hand.click("Put on Character", sidebar=True)  # the second capture, as it was solved live
    frames = int(said_of_takes(window, "frames in").split()[0])
    assert CAPTURED <= frames <= window.order("last_run")["poses"] - CAPTURED  # what was rehearsed is not among them
    assert check_exports(hand, window, tmp_path, performer, 60) == frames
    for word in ("Traceback", "Exception", "Error:"):
        assert word not in window.log(), window.log()[-3000:]


def check_exports(hand: Hand, window: BlenderWindow, folder: Path, performer: str, fps: int) -> int:
    """Export the take that is on a character from frame 1 on, import it again, and compare where joints are.

    Returns:
        The frames of the files, which have so many a second.
    """
    files, counts = {}, set()
    for kind in ("BVH", "FBX"):
        hand.click("Export", sidebar=True)
        hand.click(kind)
        hand.save_in(folder)
        counts.add(int(said_of_takes(window, f".{kind.lower()}").partition(" frames of ")[0]))
        (files[kind],) = folder.glob(f"*.{kind.lower()}")
    (frames,) = counts
    hand.shot("exported")
    bones = armatures(window)[performer]
    ours = joints(window, performer, 1.0 + np.arange(frames) * SCENE_FPS / fps, bones)
    for kind, entry, first in (("BVH", "Motion Capture (.bvh)", 1.0), ("FBX", "FBX (.fbx)", 2.0)):
        known = set(armatures(window))
        hand.menu("File", "Import", entry)
        hand.choose_file(files[kind])
        (name,) = set(armatures(window)) - known
        theirs = joints(window, name, first + np.arange(frames), bones)
        assert 1000.0 * np.linalg.norm(theirs - ours, axis=-1).max() < EXPORTED_MM, kind
    hand.shot("imported-again")
    return frames


@pytest.mark.walkthrough
def test_a_take_of_two_webcams_walks_on_all_kinds_of_characters(
    desktop: Desktop, window: BlenderWindow, shared_dir: Path, tmp_path: Path
) -> None:
    window.order("addon", name="rigify", on=True)
    hand = opened(desktop, window, "characters")
    hand.toggle("Markers")
    hand.click("Boxing")
    hand.click("Two Webcams")
    hand.toggle("Markers")
    hand.toggle("Subject")
    hand.type_over("1.75", "1.6")
    hand.toggle("Subject")
    hand.toggle("Takes")
    hand.click("Import...", sidebar=True)
    hand.click("Automatic")
    hand.click("As Chosen")
    hand.click("Put on Character")  # not yet
    hand.click("Solving")
    hand.click("From the Performer")
    hand.click("Floor from the Feet")
    hand.choose_file(shared_dir.resolve() / "two-webcams" / "sequence4_published.trc")
    assert said_of_takes(window, "imported", "import") == "1 take imported; good"
    hand.shot("imported")
    for kind, file in CHARACTERS.items():
        if file:
            path = shared_dir.resolve() / "rigs" / file
            if path.suffix == ".vrm":  # a glTF by another name, which Blender's importer goes by
                path = Path(shutil.copyfile(path, tmp_path / "example.glb"))
            import_character(hand, path)
        else:
            hand.menu("Add", "Armature", "Rigify Meta-Rigs", "Human")
            hand.menu("Rigify", "Generate Rig")
            window.wait(lambda _: "rig" in armatures(window), "a generated rig")
        # exports have the recorded rate: only keys of that rate show the same motion between the scene's frames
        window.order("set", group="perfanim_result", values={"whole_frames": kind != "xbot"})
        hand.toggle("Takes")
        name = use_active(hand, window, f"{kind}-bones")
        hand.toggle("Takes")
        hand.click("Put on Character", sidebar=True)
        assert said_of_takes(window, f" on {name}").startswith(f"{FRAMES} frames in")
        bones = window.order("map")
        assert {joint for joint in EXPECTED if bones[joint][1] != "mapped"} == set()
        assert "doubtful" not in {state for _, state in bones.values()}
        check_walk(window, name, {joint: bone for joint, (bone, _) in bones.items() if bone})
        for frame in (60, 200):
            window.order("look", frame=frame, around_deg=25.0)
            hand.shot(f"{kind}-{frame}")
        window.order("look", frame=1, around_deg=25.0)
        if kind == "xbot":
            assert check_exports(hand, window, tmp_path, name, WEBCAMS_HZ) >= FRAMES
