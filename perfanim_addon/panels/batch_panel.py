"""Batch panel."""

import bpy

from ..capture.live_capture import running_capture
from ..jobs import activity
from ..preferences.property_kinds import draw_props, property_column
from ..preferences.sidebar_tab import SidebarPanel
from . import panel_drawing


class PERFANIM_PT_batch(SidebarPanel, bpy.types.Panel):
    """Panel for a batch of takes."""

    bl_label = "Batch"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        chosen, layout = context.scene.perfanim_batch, self.layout
        column = property_column(layout)
        column.enabled = activity.current() is None
        column.prop(chosen, "plan")
        if not chosen.plan:
            draw_props(column, chosen, "takes", "out", "naming", "angles", "vrma", "character")
            if chosen.character:
                column.prop(chosen, "save_as")
        column.prop(chosen, "processes")
        layout.operator("perfanim.run_batch", icon="RENDER_ANIMATION")
        panel_drawing.draw_job(context, layout, "batch")
        if running_capture() is None:
            panel_drawing.draw_text(context, layout, *activity.message("batch"))
