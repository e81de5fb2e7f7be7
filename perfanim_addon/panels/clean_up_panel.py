"""Clean Up Motion panel."""

import bpy

from ..preferences.sidebar_tab import SidebarPanel
from . import panel_drawing

KEY = "clean_up"


class PERFANIM_PT_clean_up(SidebarPanel, bpy.types.Panel):
    """Panel for edits of the character's active action."""

    bl_label = "Clean Up Motion"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        for names in (("trim", "shift"), ("smooth", "mirror"), ("loop",)):
            row = layout.row(align=True)
            for name in names:
                row.operator(f"perfanim.{name}_motion")
            if names == ("loop",):
                row.operator("perfanim.remove_pop")
        layout.operator("perfanim.hold_feet")
        panel_drawing.draw_outcome(context, layout, KEY)
