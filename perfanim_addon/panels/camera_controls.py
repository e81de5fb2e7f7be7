"""Sub-panel of the cameras: exposure, gain, focus."""

import bpy

from ..preferences import preferences
from ..preferences.paths import ADDON
from ..preferences.property_kinds import property_column
from ..preferences.sidebar_tab import SidebarPanel
from ..settings.capture_settings import settings


class PERFANIM_PT_camera_controls(SidebarPanel, bpy.types.Panel):
    """Panel of the camera controls of the preferences."""

    bl_label = "Exposure, Gain, Focus"
    bl_parent_id = "PERFANIM_PT_cameras"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return True for real cameras, if there are preferences (not as a plain package)."""
        return settings(context).source == "CAMERAS" and ADDON in context.preferences.addons

    def draw(self, context: bpy.types.Context) -> None:
        """Draw."""
        preferences.draw_camera_controls(property_column(self.layout), context.preferences.addons[ADDON].preferences)
