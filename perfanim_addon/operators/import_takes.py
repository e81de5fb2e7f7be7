"""Import: marker takes, films and pictures become takes in the list, the first one on the character."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import TakeError, counted
from ...core.formats.markers.marker_files import READABLE
from ...core.geometry.rig_file import CALIBRATION_ENDINGS
from ...core.labelling.take_import import UPS
from ...core.session.verdict import GOOD
from ...core.solver.settings import METHODS
from ...core.system.files import exists, is_folder
from ...core.vision.sources.file_endings import IMAGE_SUFFIXES, VIDEO_ENDINGS
from .. import take_library
from ..character.selection import active_armatures
from ..jobs import activity
from ..panels import takes_panel
from ..preferences.paths import absolute
from ..preferences.property_kinds import choice, draw_props, switch
from ..settings import readiness
from ..settings.capture_settings import settings
from .database_operators import SolvingOperator
from .job_operators import FilesOperator
from .put_on_character import put_on_character

METHOD_ITEMS = [(name, name, f"The method {name!r}") for name in METHODS]
_UP_TEXTS = {
    "auto": ("From the Performer", "The axis of the file along which the performer stands"),
    "feet": ("Floor from the Feet", "The floor is found under the feet; for tilted cameras"),
    "y": ("Y", "The file's Y axis"),
    "z": ("Z", "The file's Z axis"),
}
_BODIES = (
    ("AUTO", "Automatic", "Recognise the suit, and fit a body to the motion"),
    ("CHOSEN", "As Chosen", "The performer under Subject, or an average body, with the set under Markers"),
)
_FILMED = (*VIDEO_ENDINGS, *IMAGE_SUFFIXES)
_ENDINGS = tuple(ending.replace(".take.npz", ".npz") for ending in (*READABLE, *_FILMED, *CALIBRATION_ENDINGS))


class PERFANIM_OT_import_takes(FilesOperator, SolvingOperator, bpy.types.Operator):
    """Import other systems' marker files, or the films or pictures of all cameras of a take: choose them, or the folder
    that holds them, with the calibration if it is not beside them"""

    bl_label = "Import Motion"  # beside Blender's own entry if films or pictures are dropped
    title = "Importing takes"
    panel = takes_panel.IMPORT_KEY
    filter_glob: bpy.props.StringProperty(default=";".join(f"*{ending}" for ending in _ENDINGS), options={"HIDDEN"})
    body: choice("Body", "Performer and markers of the takes", _BODIES, "AUTO")
    put_on: switch("Put on Character", "Put a single imported take onto the character", default=True)
    up: choice("Up", "Up axis of marker files", [(up, *_UP_TEXTS[up]) for up in UPS], "auto")
    method: choice("Method", "Solver method", METHOD_ITEMS, "best")
    trust_labels: switch("Trust Labels", "Use the files' labels as they are, even where they contradict the motion")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.body = "CHOSEN" if settings(context).subject else "AUTO"
        if self.files:  # they were dropped on the 3D view
            return set(context.window_manager.invoke_props_dialog(self, title="Import", confirm_text="Import"))
        return set(FilesOperator.invoke(self, context, event))

    def draw(self, context: bpy.types.Context) -> None:
        layout, chosen = self.layout, settings(context)
        layout.use_property_split = True
        draw_props(layout, self, "body", "put_on")
        if self.body == "CHOSEN":
            performer = readiness.performer_text(absolute(chosen.subject)) if chosen.subject else "average body"
            height = "" if chosen.subject else f", {chosen.subject_height:.2f} m"
            layout.label(text=f"Performer: {performer}{height}", icon="USER")
            layout.label(text=f"Markers: {Path(readiness.marker_set_source(chosen)).stem}", icon="DOT")
        if may_be_filmed(item.name for item in self.files):
            column = layout.column()
            column.label(text="Films and Pictures")
            draw_props(column, chosen, "follow")
            if chosen.follow == "MARKERS":
                draw_props(column, chosen, "marker_set")
            found = Path(chosen.calibration).name if chosen.calibration else "the one beside them"
            column.label(text=f"Calibration: {found}", icon="CAMERA_DATA")
        header, more = layout.panel("perfanim_import_solving", default_closed=True)
        header.label(text="Solving")
        if more is not None:
            draw_props(more, self, "up", "method", "trust_labels")

    def arguments(self, context: bpy.types.Context) -> list[str]:
        chosen, files = settings(context), self.chosen_files()
        for file in files:
            if not file or not exists(file):
                raise TakeError(
                    "not found" if file else "nothing is chosen", where=file or "import", advice="choose takes"
                )
        filmed = any(is_folder(file) or file.lower().endswith(_FILMED) for file in files)
        given = self._performer(chosen, filmed)
        if filmed and chosen.calibration and not any(file.lower().endswith(CALIBRATION_ENDINGS) for file in files):
            given += ["--cameras", absolute(chosen.calibration)]
        solver = ["--database", str(readiness.database_path(chosen)), "--method", self.method]
        out = ["--up", self.up, *["--trust-labels"] * self.trust_labels, "--out", str(take_library.folder())]
        return ["take", "import", *files, *given, *solver, *out]

    def _performer(self, chosen: Any, filmed: bool) -> list[str]:
        """Return the options for performer and markers."""
        people = ["--people"] if filmed and chosen.follow == "PERSON" else []
        markers = [] if people else ["--marker-set", readiness.marker_set_source(chosen)]
        if self.body == "AUTO":
            return people + (markers if filmed else [])
        subject = absolute(chosen.subject)
        performer = ["--subject", subject] if subject else ["--height", str(chosen.subject_height)]
        return [*people, *markers, *performer]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        kept, failed = summary["takes"], summary["failed"]
        first = Path(kept[0]["out"])
        takes_panel.choose(first)
        count = f"{len(kept)} of {len(kept) + len(failed)} takes" if failed else counted(len(kept), "take")
        verdicts = [GOOD] * (len(kept) == 1 and kept[0].get("verdict") == GOOD)
        notes = [warning for take in kept for warning in take["warnings"]]
        notes += [_floor_text(take["camera_heights_mm"]) for take in kept if "camera_heights_mm" in take]
        # those of a good take stand below its buttons, which would leave a small screen otherwise
        activity.set_message(takes_panel.KEY, "; ".join(notes) if verdicts else "")
        texts = [f"{count} imported", *verdicts, *failed, *([] if verdicts else notes)]
        if self.put_on and len(kept) == 1 and kept[0].get("verdict"):
            text, self.about = _put_on_active(context, first)
            texts.insert(1 + len(verdicts), text)  # the verdict first: it judges the whole take
        return "; ".join(texts)


def may_be_filmed(names: Iterable[str]) -> bool:
    """Return True if films or pictures are chosen, or no file yet, for which the browser gives an empty name."""
    given = [name.lower() for name in names if name]
    return not given or any(name.endswith(_FILMED) for name in given)


def _floor_text(heights_mm: dict[str, float]) -> str:
    cameras = ", ".join(f"{name} {height / 1000:.2f} m" for name, height in heights_mm.items())
    return f"floor found under the feet; cameras above it: {cameras}"


def _put_on_active(context: bpy.types.Context, path: Path) -> tuple[str, tuple[str, ...]]:
    """Put a take on the chosen character, or else on the active one, which becomes the chosen one."""
    chosen = settings(context)
    active = active_armatures(context)
    if chosen.armature is None and len(active) == 1:
        chosen.armature = active[0]
    return put_on_character(context, path)


class PERFANIM_FH_import(bpy.types.FileHandler):
    """Files that can be dropped on a 3D viewport"""

    bl_label = "Perfanim: Import Motion"
    bl_import_operator = "perfanim.import_takes"
    bl_file_extensions = ";".join(dict.fromkeys(_ENDINGS))

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"
