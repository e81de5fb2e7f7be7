"""Solve Again: solve a recorded take with other settings in the worker."""

from typing import Any

import bpy

from ...core.errors import SettingsError, counted
from ...core.formats.take_file.take_reader import summarise, unused_path
from ...core.session.verdict import GOOD
from .. import take_library
from ..panels import takes_panel
from ..preferences.paths import absolute
from ..preferences.property_kinds import choice, switch
from ..settings import readiness
from ..settings.capture_settings import settings
from .database_operators import SolvingOperator
from .import_takes import METHOD_ITEMS
from .operator_bases import DialogOperator
from .put_on_character import TakeOperator, put_on_character


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
    method: choice("Method", "Solver method", METHOD_ITEMS, "best")
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
        text, self.about = put_on_character(context, self._target) if self.put_on else (solved, ())
        refused = [summary["verdict"]] * (summary["verdict"] != GOOD)
        return "; ".join((text, *refused, *summary["warnings"]))
