"""Operators that solve takes in the worker: Solve Again, Import Marker Takes."""

from pathlib import Path
from typing import Any

import bpy

from ...core.errors import SettingsError, TakeError, counted
from ...core.formats.markers.marker_files import READABLE
from ...core.formats.take_file.take_reader import summarise, unused_path
from ...core.labelling.take_import import UPS
from ...core.session.verdict import GOOD
from ...core.solver.settings import METHODS
from ...core.system.files import is_file
from .. import take_library
from ..panels import takes_panel
from ..preferences.paths import absolute
from ..preferences.property_kinds import choice, draw_props, switch
from ..settings import readiness
from ..settings.capture_settings import settings
from .database_operators import SolvingOperator
from .job_operators import FilesOperator
from .operator_bases import DialogOperator
from .put_on_character import TakeOperator, put_on_character

_METHODS = [(name, name, f"The method {name!r}") for name in METHODS]
_UP_TEXTS = {
    "auto": ("From the Performer", "The axis of the file along which the performer stands"),
    "feet": ("Floor from the Feet", "The floor is found under the feet; for tilted cameras"),
    "y": ("Y", "The file's Y axis"),
    "z": ("Z", "The file's Z axis"),
}


def _recorded_or_chosen(name: str, thing: str, panel: str, default: str) -> Any:
    items = (
        ("RECORDED", "As Recorded", f"The {thing} that the take was recorded with"),
        ("CHOSEN", "As Chosen", f"The {thing} chosen under {panel}"),
    )
    return choice(name, f"Source of the {thing}", items, default)


class PERFANIM_OT_solve_take(DialogOperator, TakeOperator, SolvingOperator, bpy.types.Operator):
    """Solve the recorded markers again with other settings, as a new take"""

    bl_label = "Solve Again"
    title = "Solving the take"
    method: choice("Method", "Solver method", _METHODS, "best")
    database: _recorded_or_chosen("Database", "motion database", "Motion Database", "CHOSEN")
    performer: _recorded_or_chosen("Performer", "performer", "Subject", "RECORDED")
    cameras: _recorded_or_chosen("Cameras", "calibration of the cameras", "Cameras", "RECORDED")
    put_on: switch("Put on Character", "Put the result onto the character when it is solved", default=True)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        chosen, given = settings(context), ["--method", self.method]
        if self.database == "CHOSEN":
            given += ["--database", str(readiness.database_path(chosen))]
        known = summarise(self.path)
        for source, name, option, panel in (
            (self.performer if known.performers else "CHOSEN", "subject", "--subject", "Subject"),
            (self.cameras, "calibration", "--cameras", "Cameras"),
        ):
            if source == "CHOSEN":
                path = absolute(getattr(chosen, name))
                if not path:
                    advice = f"choose one under {panel}, or use the recorded one"
                    raise SettingsError(f"no {name} is chosen", advice=advice)
                given += [option, path]
        self._target = unused_path(take_library.folder(), f"{known.notes.name} ({self.method})")
        return ["solve", self.path, *given, "--out", str(self._target)]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        takes_panel.choose(self._target)
        name = summarise(self._target).notes.name
        solved = f"{counted(summary['frames'], 'frame')} solved as {name}"
        text = put_on_character(context, self._target) if self.put_on else solved
        refused = [summary["verdict"]] * (summary["verdict"] != GOOD)
        return "; ".join((text, *refused, *summary["warnings"]))


class PERFANIM_OT_import_takes(FilesOperator, SolvingOperator, bpy.types.Operator):
    """Solve other systems' marker files with the chosen performer, and list them"""

    bl_label = "Import Marker Takes"
    title = "Importing takes"
    panel = takes_panel.KEY
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{ending}".replace(".take.npz", ".npz") for ending in READABLE), options={"HIDDEN"}
    )
    up: choice("Up", "Up axis of the files", [(up, *_UP_TEXTS[up]) for up in UPS], "auto")
    method: choice("Method", "Solver method", _METHODS, "best")
    trust_labels: switch("Trust Labels", "Use the files' labels as they are, even where they contradict the motion")

    def draw(self, context: bpy.types.Context) -> None:
        layout, chosen = self.layout, settings(context)
        layout.use_property_split = True
        draw_props(layout, self, "up", "method", "trust_labels")
        performer = readiness.performer_text(absolute(chosen.subject)) if chosen.subject else "average body"
        height = "" if chosen.subject else f", {chosen.subject_height:.2f} m"
        layout.label(text=f"Performer: {performer}{height}", icon="USER")
        layout.label(text=f"Markers: {Path(readiness.marker_set_source(chosen)).stem}", icon="DOT")

    def arguments(self, context: bpy.types.Context) -> list[str]:
        chosen = settings(context)
        files = self.chosen_files()
        for file in files:
            if not is_file(file):
                raise TakeError(
                    "not found" if file else "nothing is chosen", where=file or "import", advice="choose marker takes"
                )
        subject = absolute(chosen.subject)
        performer = ["--subject", subject] if subject else ["--height", str(chosen.subject_height)]
        markers = ["--marker-set", readiness.marker_set_source(chosen)]
        solver = ["--database", str(readiness.database_path(chosen)), "--method", self.method]
        out = ["--up", self.up, *["--trust-labels"] * self.trust_labels, "--out", str(take_library.folder())]
        return ["take", "import", *files, *performer, *markers, *solver, *out]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        kept, failed = summary["takes"], summary["failed"]
        takes_panel.choose(Path(kept[0]["out"]))
        count = f"{len(kept)} of {len(kept) + len(failed)} takes" if failed else counted(len(kept), "take")
        return "; ".join((f"{count} imported", *failed, *(warning for take in kept for warning in take["warnings"])))
