"""Operators for the motion database: import motion, get motion data, use the starter database."""

from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import bpy

from ...core.database.public_collections import file_name, public_collections
from ...core.database.store import DATABASE_SUFFIX
from ...core.errors import DatabaseError, DownloadError, counted
from ...core.system.assets import MOTION
from ...core.system.download import check_address
from ...core.system.files import exists
from ..jobs.job import Job, command
from ..preferences import preferences
from ..preferences.online import is_online_allowed, is_this_computer
from ..preferences.paths import user_folder
from ..preferences.property_kinds import choice, draw_props, string, switch
from ..settings import readiness
from ..settings.capture_settings import settings
from .job_operators import FilesOperator, JobOperator
from .operator_bases import DialogOperator, PanelOperator, need

PANEL = "database"
_ADDRESS = "ADDRESS"
_COLLECTIONS = [(name, each.title, each.good_for) for name, each in public_collections().items()]


def starter_job(panel: str, python: str | None) -> Job:
    """Return the job that builds the starter database; DatabaseError if the shipped motion is missing."""
    if not MOTION.is_dir() or not any(MOTION.iterdir()):
        raise DatabaseError("the starter motion is missing", where=str(MOTION), advice="install the add-on again")
    build = ["database", "build", str(MOTION), "--out", str(readiness.starter_database_path())]
    return Job("Building the starter database", panel, command(build), python)


def is_starter_missing(context: bpy.types.Context) -> bool:
    """Return True if the starter database is in use and has not been built yet."""
    return readiness.uses_starter(settings(context)) and not readiness.starter_database_path().exists()


class SolvingOperator(JobOperator):
    """Base of jobs that use the motion database; a missing starter database is built first."""

    def uses_starter(self, context: bpy.types.Context) -> bool:
        """Return True if the job needs the database of the scene's settings."""
        return True

    def create_job(self, context: bpy.types.Context, python: str | None) -> Job:
        request, waits = self.request(context), self.uses_starter(context) and is_starter_missing(context)
        first = starter_job(self.panel, python) if waits else None
        return Job(self.title, self.panel, request, python, first=first)


class _BuildingOperator(JobOperator):
    """Base of jobs that build a database and select it."""

    panel = PANEL
    mirror: switch("Mirrored Copies", "Add every clip with left and right swapped")
    cull: switch("Skip Near-Duplicates", "Skip motion that is within one degree per joint angle of an earlier clip")

    def build_options(self, context: bpy.types.Context, name: str) -> list[str]:
        """Return the command's options (Blender has its own `options`)."""
        self._target = str(user_folder("databases") / f"{name or 'motion'}{DATABASE_SUFFIX}")
        chosen = ["--mirror"] * self.mirror + ["--cull"] * self.cull
        workers = preferences.workers(context)
        chosen += ["--workers", str(workers)] if workers else []
        return ["--out", self._target, "--fps", f"{settings(context).database_fps:g}", *chosen]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        settings(context).database = self._target
        skipped = len(summary.get("skipped") or ())
        text = f"{int(summary.get('frames', 0)):,} frames imported"
        text = f"{text}, {counted(skipped, 'file')} skipped" if skipped else text
        repaired = sum(row["done"] != "kept" for row in summary.get("defects") or ())
        return f"{text}, {counted(repaired, 'defect')} removed or repaired" if repaired else text


class PERFANIM_OT_build_database(FilesOperator, _BuildingOperator, bpy.types.Operator):
    """Build a motion database from BVH or AMC files, folders or archives, and use it"""

    bl_label = "Import Motion"
    title = "Importing motion"
    filter_glob: bpy.props.StringProperty(default="*.bvh;*.amc;*.asf;*.zip;*.tar;*.gz;*.tgz", options={"HIDDEN"})

    def arguments(self, context: bpy.types.Context) -> list[str]:
        sources = self.chosen_files()
        for source in sources:
            if not exists(source):
                raise DatabaseError(
                    "not found" if source else "nothing is chosen",
                    where=source or "import",
                    advice="choose motion files, or a folder",
                )
        folder = Path(sources[0]) if len(sources) == 1 else Path(self.directory)
        return ["database", "build", *sources, *self.build_options(context, folder.stem)]


class PERFANIM_OT_get_motion(DialogOperator, _BuildingOperator, bpy.types.Operator):
    """Download a public collection of motion, build a database from it, and use it"""

    bl_label = "Get Motion Data"
    title = "Getting motion data"
    collection: choice(
        "Collection",
        "Collection to download",
        [*_COLLECTIONS, (_ADDRESS, "From an Address", "An archive of BVH or AMC files elsewhere")],
    )
    address: string("Address", "http or https address of an archive of BVH or AMC files (.zip, .tar)")
    only: string(
        "Only",
        "Use only files with these names or behaviours, separated by commas, such as 09_*, 14_*, boxing; empty for all",
    )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "collection")
        known = public_collections().get(self.collection)
        if known is None:
            layout.prop(self, "address")
        else:
            for text in (f"Good for: {known.good_for}", f"Licence: {known.licence}", known.page):
                layout.label(text=text)
            layout.label(text=f"Downloads about {known.megabytes} MB to {_folder()}", icon="IMPORT")
        draw_props(layout, self, "only", "mirror", "cull")

    def arguments(self, context: bpy.types.Context) -> list[str]:
        known = public_collections().get(self.collection)
        address = known.address if known else self.address.strip()
        check_address(address)
        if not is_online_allowed() and not is_this_computer(str(urlsplit(address).hostname)):
            raise DownloadError("online access is off", advice="enable Allow Online Access in Preferences > System")
        name = known.name if known else file_name(address).partition(".")[0]
        names = [name.strip() for name in self.only.split(",") if name.strip()]
        only = [word for name in names for word in ("--include", name)]
        source = known.name if known else address
        return ["database", "get", source, "--to", str(_folder()), *only, *self.build_options(context, name)]


def _folder() -> Path:
    """Return the folder for downloaded archives."""
    return user_folder("collections")


class PERFANIM_OT_use_starter_database(PanelOperator, bpy.types.Operator):
    """Use the starter motion that comes with the add-on again"""

    bl_label = "Use Starter Database"
    panel = PANEL
    missing_input = need(lambda context: settings(context).database, "The starter database is in use")

    def run(self, context: bpy.types.Context) -> None:
        settings(context).database = ""
