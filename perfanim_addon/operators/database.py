"""The motion database: starter, import, open."""

from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from ...core.errors import DatabaseError
from ...core.system.assets import MOTION
from ..jobs import activity
from ..preferences import preferences
from ..preferences.paths import user_folder
from ..settings import readiness
from ..settings.capture_settings import settings
from . import common
from .jobs import JobOperator

PANEL = "database"


def starter_arguments() -> list[str]:
    """Return the command that makes the starter database of the shipped motion.

    Raises:
        DatabaseError: the shipped motion is missing.
    """
    if not MOTION.is_dir() or not any(MOTION.iterdir()):
        raise DatabaseError("the starter motion is missing", where=str(MOTION), advice="install the add-on again")
    return ["database", "build", str(MOTION), "--out", str(readiness.starter_database_path())]


class PERFANIM_OT_build_database(JobOperator, bpy.types.Operator, ImportHelper):
    """Make a motion database of the chosen BVH or AMC files, or of all in a folder or archive, and use it"""

    bl_idname = "perfanim.build_database"
    bl_label = "Import Motion"
    title = "Importing motion"
    panel = PANEL
    filename_ext = ""
    filter_glob: bpy.props.StringProperty(default="*.bvh;*.amc;*.asf;*.zip;*.tar;*.gz;*.tgz", options={"HIDDEN"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    mirror: bpy.props.BoolProperty(
        name="Mirrored Copies", description="Add every clip with left and right swapped", default=False
    )
    cull: bpy.props.BoolProperty(
        name="Leave Out Near-Duplicates",
        description="Leave out passages that an earlier clip holds already, within a degree per joint angle",
        default=False,
    )

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        names = [item.name for item in self.files if item.name]
        sources = [str(Path(self.directory) / name) for name in names]
        if not sources:
            sources = [self.filepath or self.directory]
        for source in sources:
            if not source or not Path(source).exists():
                raise DatabaseError("not found", where=source or "import", advice="choose motion files or a folder")
        folder = Path(sources[0]) if len(sources) == 1 else Path(self.directory)
        self._target = str(user_folder("databases") / f"{folder.stem or 'motion'}.perfdb")
        fps = settings(context).database_fps
        chosen = [*(["--mirror"] if self.mirror else []), *(["--cull"] if self.cull else [])]
        workers = preferences.workers(context)
        chosen += ["--workers", str(workers)] if workers else []
        return ["database", "build", *sources, "--out", self._target, "--fps", f"{fps:g}", *chosen]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the new database."""
        settings(context).database = self._target
        skipped = len(summary.get("skipped") or ())
        text = f"{int(summary.get('frames', 0)):,} frames imported"
        text = f"{text}, {skipped} files skipped" if skipped else text
        mended = sum(row["done"] != "kept" for row in summary.get("defects") or ())
        return f"{text}, {mended} defects cut out or mended" if mended else text


class PERFANIM_OT_use_starter_database(bpy.types.Operator):
    """Use the starter motion that comes with the add-on again"""

    bl_idname = "perfanim.use_starter_database"
    bl_label = "Use Starter"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only if another one is in use."""
        if not (common.in_scene(cls, context) and common.idle(cls)):
            return False
        if not settings(context).database:
            cls.poll_message_set("The starter motion is in use")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Forget the file."""
        settings(context).database = ""
        activity.set_message(PANEL, "")
        return {"FINISHED"}


_CLASSES = (PERFANIM_OT_build_database, PERFANIM_OT_use_starter_database)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
