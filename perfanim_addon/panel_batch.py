"""The Batch panel: many takes at once."""

import bpy

from . import panels, preferences, running
from .live import Capture

KEY = "batch"


class PERFANIM_PT_batch(bpy.types.Panel):
    """Many takes solved and written at once."""

    bl_label = "Batch"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = preferences.DEFAULT_TAB
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 101

    def draw(self, context: bpy.types.Context) -> None:
        """Draw which takes, with what, and how far it is."""
        chosen, layout = context.scene.perfanim_batch, self.layout
        column = layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.enabled = running.current() is None
        column.prop(chosen, "plan")
        if not chosen.plan:
            for name in ("takes", "out", "naming", "angles", "vrma", "character"):
                column.prop(chosen, name)
            if chosen.character:
                column.prop(chosen, "save_as")
        column.prop(chosen, "processes")
        layout.operator("perfanim.run_batch", icon="RENDER_ANIMATION")
        panels.draw_job(layout, KEY)
        if not isinstance(running.current(), Capture):
            panels.draw_text(context, layout, *running.message(KEY))


def move_to_tab(name: str) -> None:
    """Show the panel in another tab of the sidebar."""
    bpy.utils.unregister_class(PERFANIM_PT_batch)
    PERFANIM_PT_batch.bl_category = name
    bpy.utils.register_class(PERFANIM_PT_batch)


def register() -> None:
    """Register the panel."""
    PERFANIM_PT_batch.bl_category = preferences.tab(bpy.context)
    bpy.utils.register_class(PERFANIM_PT_batch)


def unregister() -> None:
    """Undo `register`."""
    bpy.utils.unregister_class(PERFANIM_PT_batch)
