"""The sidebar's tab: base class of its panels, and the tab that they stand in."""

import bpy

DEFAULT_TAB = "Perfanim"


class SidebarPanel:
    """Base of every panel in the 3D viewport's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = DEFAULT_TAB


_registered: list[type[SidebarPanel]] = []


def register_panels(tab: str, *panels: type[SidebarPanel]) -> None:
    """Register panels in a tab; parents come before their sub-panels."""
    for panel in panels:
        panel.bl_category = tab
        bpy.utils.register_class(panel)
        _registered.append(panel)


def unregister_panels(*panels: type[SidebarPanel]) -> None:
    """Undo `register_panels`."""
    for panel in reversed(panels):
        _registered.remove(panel)
        bpy.utils.unregister_class(panel)


def move_to_tab(tab: str) -> None:
    """Show all registered panels in another tab."""
    panels = tuple(_registered)
    unregister_panels(*panels)
    register_panels(tab, *panels)
