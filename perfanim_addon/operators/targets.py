"""Further targets: added, removed, measured."""

from typing import Any

import bpy

from ..panels import takes
from ..panels.targets import KEY as PANEL
from ..preferences.paths import user_folder
from . import common
from .jobs import JobOperator


class PERFANIM_OT_add_target(bpy.types.Operator):
    """Follow a prop or another performer besides the first; choose below who or what it is, and what moves along"""

    bl_idname = "perfanim.add_target"
    bl_label = "Add Target"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs."""
        return common.in_scene(cls, context) and common.idle(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it, and make it the active one."""
        shown = context.scene.perfanim_targets
        shown.entries.add()
        shown.active = len(shown.entries) - 1
        return {"FINISHED"}


class PERFANIM_OT_remove_target(bpy.types.Operator):
    """Follow this target no more; what it moves, and its actions, stay"""

    bl_idname = "perfanim.remove_target"
    bl_label = "Remove Target"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs, and if there is one."""
        if not (common.in_scene(cls, context) and common.idle(cls)):
            return False
        if not context.scene.perfanim_targets.entries:
            cls.poll_message_set("There is none")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove it."""
        shown = context.scene.perfanim_targets
        shown.entries.remove(shown.active)
        shown.active = max(min(shown.active, len(shown.entries) - 1), 0)
        return {"FINISHED"}


class PERFANIM_OT_measure_target(JobOperator, bpy.types.Operator):
    """Measure the prop from the take chosen under Takes: a capture in which it lies alone before the cameras, or is
    moved slowly"""

    bl_idname = "perfanim.measure_target"
    bl_label = "Measure from Take"
    title = "Measuring the prop"
    panel = PANEL
    called: bpy.props.StringProperty(name="Name", description="What the prop is called", default="Prop")

    @classmethod
    def lacks(cls, context: bpy.types.Context) -> str:
        """Needs a take and a target."""
        shown = context.scene.perfanim_targets
        if not 0 <= shown.active < len(shown.entries) or shown.entries[shown.active].kind != "PROP":
            return "Add a prop first"
        if not takes.active_path(context):
            return "Capture the prop lying before the cameras alone, and choose the take under Takes"
        return ""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the name."""
        return context.window_manager.invoke_props_dialog(self)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        name = bpy.path.clean_name(self.called) or "Prop"
        self._target = str(user_folder("props") / f"{name}.toml")
        self._index = context.scene.perfanim_targets.active
        take = takes.active_path(context)
        return ["calibrate", "prop", take, "--name", self.called or name, "--out", self._target]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the definition."""
        entries = context.scene.perfanim_targets.entries
        if self._index < len(entries):
            entries[self._index].definition = self._target
        told = f"{summary['name']}: {len(summary['markers_mm'])} markers, rigid to {summary['residual_mm']:.1f} mm"
        return "; ".join((told, *summary["advice"]))


_CLASSES = (PERFANIM_OT_add_target, PERFANIM_OT_remove_target, PERFANIM_OT_measure_target)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
