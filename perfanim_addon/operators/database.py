"""Operators of the motion database: import motion, use the starter database."""

from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from ...core.database.store import DATABASE_SUFFIX
from ...core.errors import DatabaseError
from ...core.system.assets import MOTION
from ..jobs.job import Job, command
from ..preferences import preferences
from ..preferences.paths import user_folder
from ..preferences.property_kinds import switch
from ..settings import readiness
from ..settings.capture_settings import settings
from .common import PanelOperator
from .jobs import JobOperator

PANEL = "database"


def starter_arguments() -> list[str]:
    """Return the command that builds the starter database from the shipped motion.

    Raises:
        DatabaseError: the shipped motion is missing.
    """
    if not MOTION.is_dir() or not any(MOTION.iterdir()):
        raise DatabaseError("the starter motion is missing", where=str(MOTION), advice="install the add-on again")
    return ["database", "build", str(MOTION), "--out", str(readiness.starter_database_path())]


def is_starter_missing(context: bpy.types.Context) -> bool:
    """Return True if the starter database is in use and has not been built yet."""
    return not settings(context).database and not readiness.starter_database_path().exists()


class SolvingOperator(JobOperator):
    """Base of jobs that use the motion database; a missing starter is built first."""

    def uses_starter(self, context: bpy.types.Context) -> bool:
        """Return True if the job needs the database of the scene's settings."""
        return True

    def create_job(self, context: bpy.types.Context, python: str | None) -> Job:
        """Start the job, after building the starter database where it is missing."""
        request, first = self.request(context), None
        if self.uses_starter(context) and is_starter_missing(context):
            first = Job("Building the starter database", self.panel, command(starter_arguments()), python)
        return Job(self.title, self.panel, request, python, first=first)


class PERFANIM_OT_build_database(JobOperator, bpy.types.Operator, ImportHelper):
    """Build a motion database from BVH or AMC files, folders or archives, and use it"""

    bl_label = "Import Motion"
    title = "Importing motion"
    panel = PANEL
    filename_ext = ""
    filter_glob: bpy.props.StringProperty(default="*.bvh;*.amc;*.asf;*.zip;*.tar;*.gz;*.tgz", options={"HIDDEN"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    mirror: switch("Mirrored Copies", "Add every clip with left and right swapped")
    cull: switch("Skip Near-Duplicates", "Skip motion that is within one degree per joint angle of an earlier clip")

    def arguments(self, context: bpy.types.Context) -> list[str]:
        names = [item.name for item in self.files if item.name]
        sources = [str(Path(self.directory) / name) for name in names]
        if not sources:
            sources = [self.filepath or self.directory]
        for source in sources:
            if not source or not Path(source).exists():
                raise DatabaseError("not found", where=source or "import", advice="choose motion files or a folder")
        folder = Path(sources[0]) if len(sources) == 1 else Path(self.directory)
        self._target = str(user_folder("databases") / f"{folder.stem or 'motion'}{DATABASE_SUFFIX}")
        fps = settings(context).database_fps
        chosen = [*(["--mirror"] if self.mirror else []), *(["--cull"] if self.cull else [])]
        workers = preferences.workers(context)
        chosen += ["--workers", str(workers)] if workers else []
        return ["database", "build", *sources, "--out", self._target, "--fps", f"{fps:g}", *chosen]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        settings(context).database = self._target
        skipped = len(summary.get("skipped") or ())
        text = f"{int(summary.get('frames', 0)):,} frames imported"
        text = f"{text}, {skipped} files skipped" if skipped else text
        repaired = sum(row["done"] != "kept" for row in summary.get("defects") or ())
        return f"{text}, {repaired} defects removed or repaired" if repaired else text


class PERFANIM_OT_use_starter_database(PanelOperator, bpy.types.Operator):
    """Use the starter motion that comes with the add-on again"""

    bl_label = "Use Starter Database"
    panel = PANEL

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        return "" if settings(context).database else "The starter database is in use"

    def run(self, context: bpy.types.Context) -> str:
        settings(context).database = ""
        return ""
