"""Button that copies the diagnostics."""

import bpy

from . import diagnostics


class PERFANIM_OT_copy_diagnostics(bpy.types.Operator):
    """Copy versions and paths to the clipboard, to be pasted into a report"""

    bl_idname = "perfanim.copy_diagnostics"
    bl_label = "Copy Diagnostics"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Copy."""
        context.window_manager.clipboard = "\n".join(diagnostics.lines(bpy.app.version_string))
        self.report({"INFO"}, "Diagnostics copied to the clipboard")
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((PERFANIM_OT_copy_diagnostics,))
