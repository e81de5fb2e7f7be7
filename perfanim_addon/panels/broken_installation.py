"""Panel shown when a bundled library cannot be loaded."""

import bpy

from ..preferences import diagnostics
from ..preferences.sidebar_tab import SidebarPanel


class PERFANIM_PT_broken(SidebarPanel, bpy.types.Panel):
    """Panel with the error and its remedy."""

    bl_idname = "PERFANIM_PT_broken"
    bl_label = "Perfanim cannot run"

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.label(text=diagnostics.problem, icon="ERROR")
        column.label(text="Install the archive made for this Blender's Python and platform.")
        column.operator("perfanim.copy_diagnostics", icon="COPYDOWN")
