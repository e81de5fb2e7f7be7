"""Additional Targets panel: props, further performers and further characters."""

import bpy

from ..capture.live_capture import running_capture
from ..preferences.property_kinds import draw_props, property_column
from ..preferences.sidebar_tab import SidebarPanel
from ..settings import target_settings
from . import character_panel, panel_drawing

KEY = "targets"


class PERFANIM_UL_targets(panel_drawing.RowList, bpy.types.UIList):
    """List with one target and its object or armature per row."""

    bl_idname = "PERFANIM_UL_targets"

    def draw_row(self, layout: bpy.types.UILayout, item: target_settings.PERFANIM_PG_target) -> None:
        split = layout.split(factor=0.5)
        is_prop = item.kind == "PROP"
        split.label(text=target_settings.title(item), icon="EMPTY_AXIS" if is_prop else "USER")
        moved = item.object if is_prop else item.armature
        split.label(text=moved.name if moved else "new at start" if item.kind != "CHARACTER" else "none")


class PERFANIM_PT_targets(SidebarPanel, bpy.types.Panel):
    """Panel for props, additional performers and additional characters."""

    bl_label = "Additional Targets"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        entries = context.scene.perfanim_targets.entries
        row = self.layout.row()
        if entries:
            problem = target_settings.problem(context.scene)
            row.alert = bool(problem)
            row.label(text=str(len(entries)), icon="ERROR" if problem else "CHECKMARK")
        row.separator()

    def draw(self, context: bpy.types.Context) -> None:
        layout, shown = self.layout, context.scene.perfanim_targets
        column = layout.column()
        column.enabled = running_capture() is None
        row = column.row()
        row.template_list("PERFANIM_UL_targets", "", shown, "entries", shown, "active", rows=2)
        buttons = row.column(align=True)
        buttons.operator("perfanim.add_target", text="", icon="ADD")
        buttons.operator("perfanim.remove_target", text="", icon="REMOVE")
        if 0 <= shown.active < len(shown.entries):
            _draw_fields(property_column(column), shown.entries[shown.active], shown.active)
        panel_drawing.draw_text(context, layout, target_settings.problem(context.scene), "ERROR")
        panel_drawing.draw_outcome(context, layout, KEY)


def _draw_fields(layout: bpy.types.UILayout, entry: target_settings.PERFANIM_PG_target, index: int) -> None:
    layout.prop(entry, "kind")
    if entry.kind == "PROP":
        draw_props(layout, entry, "definition", "object")
        layout.operator("perfanim.measure_target", icon="DRIVER_DISTANCE")
        return
    if entry.kind == "PERFORMER":
        row = layout.row(align=True)
        row.prop(entry, "subject")
        row.operator_menu_enum("perfanim.use_profile", "profile", text="", icon="COMMUNITY").target = index
    layout.prop(entry, "armature")
    character_panel.draw_bones(layout, entry.armature, KEY)
