"""Preferences: name of the sidebar's tab, the worker's Python, the cameras' exposure, gain and focus, diagnostics."""

import sys
from typing import Any

import bpy

from . import diagnostics
from .place import ADDON

DEFAULT_TAB = "Perfanim"


def _tab_changed(preferences: "PERFANIM_AP_preferences", context: bpy.types.Context) -> None:
    for name in ("panels", "panel_takes"):
        panels = sys.modules.get(f"{__package__}.{name}")
        if panels is not None:
            panels.move_to_tab(preferences.tab or DEFAULT_TAB)


def _automatic(what: str) -> Any:
    return bpy.props.BoolProperty(name=f"Automatic {what}", description=f"Leave {what} to the camera", default=True)


class PERFANIM_PG_camera_controls(bpy.types.PropertyGroup):
    """What one camera is told, on this computer; kept from session to session."""

    exposure_auto: _automatic("exposure")
    exposure_ms: bpy.props.FloatProperty(
        name="Exposure (ms)",
        description="Milliseconds that the shutter is open: 2 to 4 keep markers of a fast performer sharp",
        default=4,
        min=0.1,
        max=1000,
    )
    gain_auto: _automatic("gain")
    gain: bpy.props.FloatProperty(name="Gain", description="In the camera's own numbers", default=0, min=0, max=1000)
    focus_auto: _automatic("focus")
    focus: bpy.props.FloatProperty(
        name="Focus",
        description="In the camera's own numbers; a focus that changes spoils the calibration",
        default=0,
        min=0,
        max=1023,
    )


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
    left_camera: bpy.props.PointerProperty(type=PERFANIM_PG_camera_controls)
    right_camera: bpy.props.PointerProperty(type=PERFANIM_PG_camera_controls)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "tab")
        layout.prop(self, "worker_python")
        draw_camera_controls(layout, self)
        box = layout.box()
        for line in diagnostics.lines(bpy.app.version_string):
            box.label(text=line)
        box.operator("perfanim.copy_diagnostics", icon="COPYDOWN")


def draw_camera_controls(layout: bpy.types.UILayout, preferences: PERFANIM_AP_preferences) -> None:
    """Draw exposure, gain and focus of both cameras."""
    for title, told in (("Left Camera", preferences.left_camera), ("Right Camera", preferences.right_camera)):
        column = layout.column(heading=title)
        for name in ("exposure", "gain", "focus"):
            row = column.row()
            value = row.row()
            value.enabled = not getattr(told, f"{name}_auto")
            value.prop(told, "exposure_ms" if name == "exposure" else name)
            row.prop(told, f"{name}_auto", text="Auto")


def camera_controls(context: bpy.types.Context) -> list[dict[str, float | None]]:
    """Return what the left and the right camera are told, as `core.sources.camera_controls` takes it."""
    addon = context.preferences.addons.get(ADDON)
    return [_told(addon.preferences.left_camera), _told(addon.preferences.right_camera)] if addon else []


def _told(chosen: PERFANIM_PG_camera_controls) -> dict[str, float | None]:
    return {
        "exposure_s": None if chosen.exposure_auto else chosen.exposure_ms / 1000.0,
        "gain": None if chosen.gain_auto else chosen.gain,
        "focus": None if chosen.focus_auto else chosen.focus,
    }


def worker_python(context: bpy.types.Context) -> str | None:
    """Return the Python that the user chose for the worker, None for Blender's own."""
    addon = context.preferences.addons.get(ADDON)
    return bpy.path.abspath(addon.preferences.worker_python) or None if addon else None


def tab(context: bpy.types.Context) -> str:
    """Return the name of the sidebar's tab."""
    addon = context.preferences.addons.get(ADDON)
    return addon.preferences.tab or DEFAULT_TAB if addon else DEFAULT_TAB


register, unregister = bpy.utils.register_classes_factory((PERFANIM_PG_camera_controls, PERFANIM_AP_preferences))
