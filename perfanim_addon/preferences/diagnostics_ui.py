"""Diagnostics in the preferences, and the button that copies them."""

import bpy

from . import diagnostics


class PERFANIM_OT_copy_diagnostics(bpy.types.Operator):
    """Copy versions, folders and self-test results to the clipboard, for a report"""

    bl_idname = "perfanim.copy_diagnostics"
    bl_label = "Copy Diagnostics"

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.window_manager.clipboard = "\n".join(diagnostics.lines(bpy.app.version_string, load=True))
        self.report({"INFO"}, "Diagnostics copied to the clipboard")
        return {"FINISHED"}


def draw(layout: bpy.types.UILayout) -> None:
    """Draw buttons and facts."""
    row = layout.row(align=True)
    if hasattr(bpy.types, "PERFANIM_OT_self_test"):  # missing if a library is broken
        row.operator("perfanim.self_test", icon="PLAY")
        row.operator("perfanim.cancel_job", text="", icon="X")
    row.operator("perfanim.copy_diagnostics", icon="COPYDOWN")
    for line in diagnostics.lines(bpy.app.version_string):
        layout.label(text=line)
