"""What a batch of takes is done with: kept in the scene, and as a plan file."""

from pathlib import Path
from typing import Any

import bpy

from ...core.cli.batch.plan import plan_of
from ...core.errors import SettingsError
from ...core.formats.markers.marker_files import is_recorded
from ...core.system.files import write_toml
from .. import take_library
from ..preferences import preferences
from ..preferences.attach_settings import hung_on
from ..preferences.paths import absolute
from . import readiness
from .capture_settings import settings

PLAN = "plan.toml"  # in the folder of the results

NAMINGS = (
    ("cmu", "CMU", "The product's own names, those of the CMU Motion Capture Database"),
    ("unreal", "Unreal", "The mannequin of Unreal Engine 5"),
    ("vrm", "VRM", "Humanoid bones of VRM 1.0"),
    ("mixamo", "Mixamo", "Mixamo's"),
)


class PERFANIM_PG_batch(bpy.types.PropertyGroup):
    """Which takes, with what, into which folder."""

    plan: bpy.props.StringProperty(
        name="Plan", description="Plan file (TOML) that says all; empty: as chosen below", subtype="FILE_PATH"
    )
    takes: bpy.props.StringProperty(
        name="Takes",
        description="Folder of takes and those in it: C3D, TRC, CSV, TSV, recorded ones; empty: those of the list",
        subtype="DIR_PATH",
    )
    out: bpy.props.StringProperty(
        name="Results", description="Folder for the results; what is done there already stays", subtype="DIR_PATH"
    )
    naming: bpy.props.EnumProperty(
        name="Names", description="Whose names the joints have in the files", items=NAMINGS, default="cmu"
    )
    angles: bpy.props.BoolProperty(
        name="Joint Angles", description="Also a table of joint angles (CSV) of each take", default=False
    )
    vrma: bpy.props.BoolProperty(name="VRM Animation", description="Also a VRM animation of each take", default=False)
    character: bpy.props.StringProperty(
        name="Character",
        description="Also put each motion onto the character of this file (.blend, glTF, VRM, FBX); empty: onto none",
        subtype="FILE_PATH",
    )
    save_as: bpy.props.EnumProperty(
        name="Save As",
        description="Kind of the characters' files",
        items=(
            ("blend", "Blender File", "The whole scene (.blend)"),
            ("fbx", "FBX", "Character and motion (.fbx)"),
            ("glb", "glTF", "Character and motion (.glb)"),
        ),
    )
    processes: bpy.props.IntProperty(
        name="Processes",
        description="How many takes are done at a time; 0: one a core but one, which is left to Blender",
        default=0,
        min=0,
        max=256,
    )


def problem(chosen: Any) -> str:
    """Return what is missing for a batch, "" when it can be started."""
    if chosen.plan:
        return "" if Path(absolute(chosen.plan)).is_file() else "the plan file is not there"
    if chosen.takes and not Path(absolute(chosen.takes)).is_dir():
        return "the folder of takes is not there"
    if chosen.character and not Path(absolute(chosen.character)).is_file():
        return "the character's file is not there"
    return "" if chosen.out else "choose a folder for the results"


def plan_file(context: bpy.types.Context, chosen: Any) -> Path:
    """Return the plan that is chosen, or the one that is written into the folder of the results as is chosen.

    Own takes are solved for who was recorded, all others for the chosen performer with the chosen markers.

    Raises:
        SettingsError: there are no takes, or nobody is chosen whom the others show.
        FormatError: the folder cannot be written.
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
            raise SettingsError(
                "no performer is chosen, whom this take shows", where=take.take, advice="choose one under Subject"
            )
        rows.append({"take": take.take, "name": take.name, **({} if own else performer)})
    also = [kind for kind, wanted in (("angles.csv", chosen.angles), ("vrma", chosen.vrma)) if wanted]
    path = Path(absolute(chosen.out)) / PLAN
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
        if blender_program():
            shared["blender"] = blender_program()
    write_toml(path, {**shared, "take": rows})
    return path


def blender_program() -> str:
    """Return the file of the Blender that runs, "" for Blender as a Python module, which the worker's Python has."""
    return str(bpy.app.binary_path)


register, unregister = hung_on(bpy.types.Scene, "perfanim_batch", PERFANIM_PG_batch)
