"""The panel Further Targets: props that are followed besides the performer, and their objects."""

from typing import Any

import bpy

from . import panels, preferences, running, targets
from .live import Capture

KEY = "targets"
_ROWS = 2


class PERFANIM_UL_targets(bpy.types.UIList):
    """One line a target: the prop and the object that follows it."""

    bl_idname = "PERFANIM_UL_targets"

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: Any,
        item: targets.PERFANIM_PG_target,
        icon: int,
        active_data: Any,
        active_property: str,
    ) -> None:
        """Draw."""
        split = layout.split(factor=0.5)
        split.label(text=targets.title(item), icon="EMPTY_AXIS")
        split.label(text=item.object.name if item.object else "new at start")


class PERFANIM_PT_targets(bpy.types.Panel):
    """Props that are followed besides the performer."""

    bl_label = "Further Targets"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = preferences.DEFAULT_TAB
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 50

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """Draw how many there are at the right of the header line."""
        entries = context.scene.perfanim_targets.entries
        row = self.layout.row()
        if entries:
            problem = targets.problem(context.scene)
            row.alert = bool(problem)
            row.label(text=str(len(entries)), icon="ERROR" if problem else "CHECKMARK")
        row.separator()

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the list, and the fields of the active target."""
        layout, shown = self.layout, context.scene.perfanim_targets
        column = layout.column()
        column.enabled = not isinstance(running.current(), Capture)
        row = column.row()
        row.template_list("PERFANIM_UL_targets", "", shown, "entries", shown, "active", rows=_ROWS)
        buttons = row.column(align=True)
        buttons.operator("perfanim.add_target", text="", icon="ADD")
        buttons.operator("perfanim.remove_target", text="", icon="REMOVE")
        if 0 <= shown.active < len(shown.entries):
            fields = column.column()
            fields.use_property_split = True
            fields.use_property_decorate = False
            fields.prop(shown.entries[shown.active], "definition")
            fields.prop(shown.entries[shown.active], "object")
            column.operator("perfanim.measure_target", icon="DRIVER_DISTANCE")
        panels.draw_text(context, layout, targets.problem(context.scene), "ERROR")
        panels.draw_job(layout, KEY)
        panels.draw_text(context, layout, *running.message(KEY))


def move_to_tab(name: str) -> None:
    """Show the panel in another tab of the sidebar."""
    bpy.utils.unregister_class(PERFANIM_PT_targets)
    PERFANIM_PT_targets.bl_category = name
    bpy.utils.register_class(PERFANIM_PT_targets)


def register() -> None:
    """Register list and panel."""
    bpy.utils.register_class(PERFANIM_UL_targets)
    PERFANIM_PT_targets.bl_category = preferences.tab(bpy.context)
    bpy.utils.register_class(PERFANIM_PT_targets)


def unregister() -> None:
    """Undo `register`."""
    bpy.utils.unregister_class(PERFANIM_PT_targets)
    bpy.utils.unregister_class(PERFANIM_UL_targets)
