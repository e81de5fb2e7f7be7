"""Settings for a batch of takes, stored in the scene, and its plan file."""

from pathlib import Path
from typing import Any

import bpy

from ...core.cli.batch.plan import plan_of
from ...core.errors import SettingsError
from ...core.formats.markers.marker_files import is_recorded
from ...core.system.files import is_file, is_folder, write_toml
from .. import take_library
from ..preferences import preferences
from ..preferences.paths import absolute
from ..preferences.property_kinds import choice, file_path, folder_path, switch, whole_number
from . import readiness
from .capture_settings import settings

NAMINGS = (
    ("cmu", "CMU", "The CMU Motion Capture Database"),
    ("unreal", "Unreal", "The mannequin of Unreal Engine 5"),
    ("vrm", "VRM", "Humanoid bones of VRM 1.0"),
    ("mixamo", "Mixamo", "Characters of Mixamo"),
    ("blender", "Blender", "As on a new character: with .L and .R, so that Blender can flip poses"),
)


class PERFANIM_PG_batch(bpy.types.PropertyGroup):
    """Settings of the Batch panel."""

    attached_to = (bpy.types.Scene, "perfanim_batch")
    plan: file_path("Plan", "Plan file (TOML); empty for the settings below")
    takes: folder_path(
        "Takes", "Folder of takes (C3D, TRC, CSV, TSV, recorded), with subfolders; empty for the takes in the list"
    )
    out: folder_path("Results", "Folder for the results; finished takes in it are skipped")
    naming: choice("Naming", "Joint naming convention of the files", NAMINGS, "cmu")
    angles: switch("Joint Angles", "Also write a table of joint angles (CSV) of each take")
    vrma: switch("VRM Animation", "Also write a VRM animation of each take")
    character: file_path("Character", "Also put each motion onto the character in this file (.blend, glTF, VRM, FBX)")
    save_as: choice(
        "Save As",
        "File format of the characters",
        (
            ("blend", "Blender File", "The whole scene (.blend)"),
            ("fbx", "FBX", "Character and motion (.fbx)"),
            ("glb", "glTF", "Character and motion (.glb)"),
        ),
    )
    processes: whole_number("Processes", "Number of takes solved at the same time; 0 for all cores but one", 0, 0, 256)


def problem(chosen: Any) -> str:
    """Return the missing input of a batch, or ""."""
    if chosen.plan:
        return "" if is_file(absolute(chosen.plan)) else "plan file not found"
    if chosen.takes and not is_folder(absolute(chosen.takes)):
        return "folder of takes not found"
    if chosen.character and not is_file(absolute(chosen.character)):
        return "file of the character not found"
    return "" if chosen.out else "choose a folder for the results"


def plan_file(context: bpy.types.Context, chosen: Any) -> Path:
    """Return the chosen plan, or write one to the folder of the results.

    Recorded takes are solved for their own performer, all others for the chosen performer and markers.

    Raises:
        SettingsError: There are no takes, or no performer is chosen for takes of other systems.
        FormatError: The folder cannot be written.
    """
    if chosen.plan:
        return Path(absolute(chosen.plan))
    scene = settings(context)
    source = absolute(chosen.takes) or str(take_library.folder())
    performer = {"marker_set": readiness.marker_set_source(scene), "up": "auto", "subject": absolute(scene.subject)}
    rows = []
    for take in plan_of([source], {}).takes:
        own = is_recorded(take.take)
        if not own and not scene.subject:
            advice = "choose one under Subject"
            raise SettingsError("no performer is chosen for this take", where=take.take, advice=advice)
        rows.append({"take": take.take, "name": take.name, **({} if own else performer)})
    also = [kind for kind, wanted in (("angles.csv", chosen.angles), ("vrma", chosen.vrma)) if wanted]
    path = Path(absolute(chosen.out)) / "plan.toml"
    shared: dict[str, Any] = {
        "out": str(path.parent),
        "database": str(readiness.database_path(scene)),
        "method": preferences.method(context),
        "feet": scene.feet,
        "naming": chosen.naming,
    }
    if also:
        shared["also"] = also
    if chosen.character:
        shared |= {"to": absolute(chosen.character), "save_as": chosen.save_as}
        if bpy.app.binary_path:  # "" if Blender runs as a Python module
            shared["blender"] = bpy.app.binary_path
    write_toml(path, {**shared, "take": rows})
    return path
