"""Sub-panel of the capture: motion sent to other programs."""

import bpy

from ..jobs import activity
from ..preferences.property_kinds import draw_props, property_column
from ..preferences.sidebar_tab import SidebarPanel
from ..settings import vmc_output


class PERFANIM_PT_sending(SidebarPanel, bpy.types.Panel):
    """Panel of the VMC output."""

    bl_label = "Send by VMC"
    bl_parent_id = "PERFANIM_PT_capture"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: bpy.types.Context) -> None:
        """Draw the switch."""
        self.layout.enabled = activity.current() is None
        self.layout.prop(context.scene.perfanim_sending, "on", text="")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the receiver."""
        chosen = context.scene.perfanim_sending
        column = property_column(self.layout)
        column.enabled = chosen.on and activity.current() is None
        draw_props(column, chosen, "host", "port")
        wrong = vmc_output.problem(chosen) if chosen.on else ""
        if wrong:
            self.layout.label(text=wrong, icon="ERROR")
