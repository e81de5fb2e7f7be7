"""Scenes saved by version 0.1 (commit 140cb87) open with their settings."""

from pathlib import Path
from typing import Any

import bpy

SAVED = Path(__file__).parent / "version-1.blend"


def test_settings_of_an_old_file_keep_their_values(addon: Any) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(SAVED), load_ui=False)
    scene = bpy.context.scene
    wanted = {
        "source": "CAMERAS", "left_device": 1, "right_device": 2, "further_devices": "3, 4", "marker_set": "boxing",
        "threshold_auto": False, "threshold": 77.0, "subject": "//../anna.toml", "subject_name": "Anna",
        "database": "//../motion.perfdb", "record_countdown_s": 3, "smoothing_ms": 40.0, "feet": "auto",
    }  # fmt: skip
    assert {name: getattr(scene.perfanim, name) for name in wanted} == wanted
    assert scene.perfanim.armature.name == "Hero"
    prop, performer = scene.perfanim_targets.entries
    assert (prop.kind, prop.definition) == ("PROP", "//../prop-sword.toml")
    assert (performer.kind, performer.subject, performer.armature.name) == ("PERFORMER", "//../ben.toml", "Ben")
    batch = scene.perfanim_batch
    assert (batch.takes, batch.out, batch.naming, batch.angles) == ("//../takes", "//../solved", "mixamo", True)
    assert batch.processes == 2
    joints = scene.perfanim.armature.perfanim_character.joints
    assert (joints[0].name, joints[0].bone) == ("root", "mixamorig:Hips")
