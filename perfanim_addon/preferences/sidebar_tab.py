"""Base class of the sidebar's panels, and the tab they appear in."""

import bpy

DEFAULT_TAB = "Perfanim"


class SidebarPanel:
    """Base of the panels in the 3D viewport's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = DEFAULT_TAB


_registered: list[type[SidebarPanel]] = []


def register_panel(panel: type[SidebarPanel], tab: str) -> None:
    """Register a panel below the others in a tab; parents must come before sub-panels."""
    panel.bl_category, panel.bl_order = tab, len(_registered)
    bpy.utils.register_class(panel)
    _registered.append(panel)


def unregister_panel(panel: type[SidebarPanel]) -> None:
    """Undo `register_panel`."""
    _registered.remove(panel)
    bpy.utils.unregister_class(panel)


def move_to_tab(tab: str) -> None:
    """Show all registered panels in another tab."""
    panels = tuple(_registered)
    for panel in reversed(panels):
        unregister_panel(panel)
    for panel in panels:
        register_panel(panel, tab)
