"""Exposure, gain and focus in the sidebar, below the cameras."""

import bpy

from ..preferences import preferences
from ..preferences.paths import ADDON
from ..preferences.sidebar_tab import SidebarPanel
from ..settings.capture_settings import settings


class PERFANIM_PT_camera_controls(SidebarPanel, bpy.types.Panel):
    """What the cameras are told; kept in the preferences."""

    bl_label = "Exposure, Gain, Focus"
    bl_parent_id = "PERFANIM_PT_cameras"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for real cameras, and where the preferences are (not when loaded as a plain package)."""
        return settings(context).source == "CAMERAS" and ADDON in context.preferences.addons

    def draw(self, context: bpy.types.Context) -> None:
        """Draw."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        preferences.draw_camera_controls(layout, context.preferences.addons[ADDON].preferences)
