"""Operators for the additional targets: add, remove, measure."""

from typing import Any

import bpy

from ...core.errors import counted
from ..panels import takes_panel
from ..panels.targets_panel import KEY as PANEL
from ..preferences.paths import user_folder
from ..preferences.property_kinds import string
from .job_operators import JobOperator
from .operator_bases import DialogOperator, UndoOperator, need


class PERFANIM_OT_add_target(UndoOperator, bpy.types.Operator):
    """Capture a prop or another performer besides the first, or move another character"""

    bl_label = "Add Target"
    panel = PANEL

    def run(self, context: bpy.types.Context) -> None:
        shown = context.scene.perfanim_targets
        shown.entries.add()
        shown.active = len(shown.entries) - 1


class PERFANIM_OT_remove_target(UndoOperator, bpy.types.Operator):
    """Remove the target; its object or character and their actions stay"""

    bl_label = "Remove Target"
    panel = PANEL
    missing_input = need(lambda context: context.scene.perfanim_targets.entries, "There are no targets")

    def run(self, context: bpy.types.Context) -> None:
        shown = context.scene.perfanim_targets
        shown.entries.remove(shown.active)
        shown.active = max(min(shown.active, len(shown.entries) - 1), 0)


class PERFANIM_OT_measure_target(DialogOperator, JobOperator, bpy.types.Operator):
    """Measure the prop from the selected take, which must show the prop alone"""

    bl_label = "Measure from Take"
    title = "Measuring the prop"
    panel = PANEL
    called: string("Name", "Name of the prop", "Prop")

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        shown = context.scene.perfanim_targets
        if not 0 <= shown.active < len(shown.entries) or shown.entries[shown.active].kind != "PROP":
            return "Add a prop first"
        if not takes_panel.active_path(context):
            return "Capture the prop alone, lying still, and select the take under Takes"
        return ""

    def arguments(self, context: bpy.types.Context) -> list[str]:
        name = bpy.path.clean_name(self.called) or "Prop"
        self._target = str(user_folder("props") / f"{name}.toml")
        self._index = context.scene.perfanim_targets.active
        take = takes_panel.active_path(context)
        return ["calibrate", "prop", take, "--name", self.called or name, "--out", self._target]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        entries = context.scene.perfanim_targets.entries
        if self._index < len(entries):
            entries[self._index].definition = self._target
        markers = counted(len(summary["markers_mm"]), "marker")
        text = f"{summary['name']}: {markers}, rigid to {summary['residual_mm']:.1f} mm"
        return "; ".join((text, *summary["advice"]))
