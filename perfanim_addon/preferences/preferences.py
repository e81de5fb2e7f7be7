"""Preferences of the add-on."""

from collections.abc import Iterator
from typing import Any

import bpy

from ...core.solver.settings import METHODS
from ...core.vision.sources.source_requests import CameraControls
from . import body_network, diagnostics_ui, manual, sidebar_tab
from .paths import ADDON, CHOSEN_FOLDERS, default_folder, folder_problem
from .property_kinds import choice, draw_props, file_path, folder_path, number, pointer, string, switch, whole_number
from .sidebar_tab import DEFAULT_TAB

_METHOD_TEXTS = {
    "best": "The most accurate method",
    "local-pca": "A local PCA model of the pose, with the settings of the published method",
    "lwr": "Locally weighted regression of the nearest recorded poses",
    "nearest": "The nearest recorded pose, unchanged",
}


PROPOSED_MS = 4  # exposure time that keeps fast markers sharp


def _marker_sets(_self: object, _context: object, typed: str) -> Iterator[str]:
    from ...core.markers.marker_set import marker_set_names  # imports numpy, which may be broken

    return (name for name in marker_set_names() if typed in name)


def _folder(name: str, content: str) -> Any:
    return folder_path(name, f"Folder for {content}; empty for the add-on's user folder")


def _automatic(what: str) -> Any:
    return switch(f"Automatic {what}", f"Leave {what} to the camera", default=True)


class PERFANIM_PG_camera_controls(bpy.types.PropertyGroup):
    """Controls of one camera, stored in the preferences."""

    exposure_auto: _automatic("exposure")
    exposure_ms: number("Exposure (ms)", "Exposure time: 2 to 4 ms keep fast markers sharp", PROPOSED_MS, 0.1, 1000)
    gain_auto: _automatic("gain")
    gain: number("Gain", "In the camera's own units", 0, 0, 1000)
    focus_auto: _automatic("focus")
    focus: number("Focus", "In the camera's own units. Changing the focus invalidates the calibration", 0, 0, 1023)


class PERFANIM_AP_preferences(bpy.types.AddonPreferences):
    """The add-on's preferences."""

    bl_idname = ADDON

    tab: string(
        "Sidebar Tab",
        "Name of the tab in the 3D viewport's sidebar",
        DEFAULT_TAB,
        update=lambda self, _context: sidebar_tab.move_to_tab(self.tab or DEFAULT_TAB),
    )
    takes_folder: _folder("Takes", "recorded takes")
    databases_folder: _folder("Databases", "motion databases")
    profiles_folder: _folder("Profiles", "calibrated performers and cameras, and bone maps")
    marker_set: string("Marker Set", "Marker set of new files", "boxing", search=_marker_sets)
    database: file_path("Database", "Motion database of new files; empty for the starter database")
    method: choice(
        "Method",
        "Solver method while capturing; takes can be solved again with another method",
        [(name, name, _METHOD_TEXTS[name]) for name in METHODS],
        "best",
    )
    worker_python: file_path("Worker's Python", "Python executable for the worker; empty for Blender's own")
    workers: whole_number(
        "Processes", "Number of processes that read motion files during Import Motion; 0 for one per core", 0, 0, 64
    )
    left_camera: pointer("Left Camera", "Controls of the left camera", PERFANIM_PG_camera_controls)
    right_camera: pointer("Right Camera", "Controls of the right camera", PERFANIM_PG_camera_controls)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator("wm.url_open", text="Manual", icon="HELP").url = (manual.FOLDER / "index.html").as_uri()
        layout.use_property_split = True
        layout.prop(self, "tab")
        folders = _section(layout, "Folders")
        for kind, name in CHOSEN_FOLDERS.items():
            folders.prop(self, name)
            if not getattr(self, name):
                folders.label(text=f"Now {default_folder(kind)}", icon="FILE_FOLDER")
            problem = folder_problem(kind)
            if problem:
                folders.label(text=problem, icon="ERROR")
        draw_props(_section(layout, "New Files and Captures"), self, "marker_set", "database", "method")
        draw_props(_section(layout, "Worker"), self, "worker_python", "workers")
        draw_camera_controls(layout, self)
        body_network.draw(_section(layout, "Body Network"))
        diagnostics_ui.draw(_section(layout, "Diagnostics"))


def _section(layout: bpy.types.UILayout, title: str) -> bpy.types.UILayout:
    column = layout.column()
    column.label(text=title)
    return column


def draw_camera_controls(layout: bpy.types.UILayout, preferences: PERFANIM_AP_preferences) -> None:
    """Draw exposure, gain and focus of both cameras."""
    for title, controls in (("Left Camera", preferences.left_camera), ("Right Camera", preferences.right_camera)):
        column = _section(layout, title)
        for name, heading in (("exposure", "Exposure (ms)"), ("gain", "Gain"), ("focus", "Focus")):
            row = column.row(heading=heading)
            row.prop(controls, f"{name}_auto", text="Auto")
            value = row.row()
            value.enabled = not getattr(controls, f"{name}_auto")
            value.prop(controls, "exposure_ms" if name == "exposure" else name, text="")


def camera_controls(context: bpy.types.Context) -> tuple[CameraControls, ...]:
    """Return the controls of the left and right camera for the worker."""
    found = chosen(context)
    return (_controls(found.left_camera), _controls(found.right_camera)) if found else ()


def cameras_of(context: bpy.types.Context) -> list[PERFANIM_PG_camera_controls]:
    """Return the stored controls of the left and right camera, none if the add-on is loaded as a plain package."""
    found = chosen(context)
    return [found.left_camera, found.right_camera] if found else []


def _controls(camera: PERFANIM_PG_camera_controls) -> CameraControls:
    return CameraControls(
        exposure_s=None if camera.exposure_auto else camera.exposure_ms / 1000.0,
        gain=None if camera.gain_auto else camera.gain,
        focus=None if camera.focus_auto else camera.focus,
    )


def chosen(context: bpy.types.Context) -> PERFANIM_AP_preferences | None:
    """Return the preferences, or None if the add-on is loaded as a plain package."""
    addon = context.preferences.addons.get(ADDON)
    return addon.preferences if addon else None


def worker_python(context: bpy.types.Context) -> str | None:
    """Return the chosen Python of the worker, or None for Blender's own."""
    return bpy.path.abspath(getattr(chosen(context), "worker_python", "")) or None


def method(context: bpy.types.Context) -> str:
    """Return the solver method for captures."""
    return getattr(chosen(context), "method", METHODS[0])


def workers(context: bpy.types.Context) -> int:
    """Return the number of processes that read motion files; 0 for one per core."""
    return getattr(chosen(context), "workers", 0)


def tab(context: bpy.types.Context) -> str:
    """Return the name of the sidebar's tab."""
    return getattr(chosen(context), "tab", "") or DEFAULT_TAB
