"""Preferences: name of the sidebar's tab, the worker's Python, diagnostics."""

import sys

import bpy

from . import diagnostics
from .place import ADDON

DEFAULT_TAB = "Perfanim"


def _tab_changed(preferences: "PERFANIM_AP_preferences", context: bpy.types.Context) -> None:
    panels = sys.modules.get(f"{__package__}.panels")
    if panels is not None:
        panels.move_to_tab(preferences.tab or DEFAULT_TAB)


class PERFANIM_AP_preferences(bpy.types.AddonPreferences):
    """The add-on's preferences."""

    bl_idname = ADDON

    tab: bpy.props.StringProperty(
        name="Sidebar Tab",
        description="Name of the tab in the 3D viewport's sidebar",
        default=DEFAULT_TAB,
        update=_tab_changed,
    )
    worker_python: bpy.props.StringProperty(
        name="Worker's Python",
        description="Python program that runs the cameras; leave empty to use Blender's own",
        subtype="FILE_PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "tab")
        layout.prop(self, "worker_python")
        box = layout.box()
        for line in diagnostics.lines(bpy.app.version_string):
            box.label(text=line)
        box.operator("perfanim.copy_diagnostics", icon="COPYDOWN")


def worker_python(context: bpy.types.Context) -> str | None:
    """Return the Python that the user chose for the worker, None for Blender's own."""
    addon = context.preferences.addons.get(ADDON)
    return bpy.path.abspath(addon.preferences.worker_python) or None if addon else None


def tab(context: bpy.types.Context) -> str:
    """Return the name of the sidebar's tab."""
    addon = context.preferences.addons.get(ADDON)
    return addon.preferences.tab or DEFAULT_TAB if addon else DEFAULT_TAB


register, unregister = bpy.utils.register_classes_factory((PERFANIM_AP_preferences,))
