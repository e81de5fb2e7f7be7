"""Registration in two steps.

First preferences and diagnostics, which need only Blender and the standard library; then the rest, which needs numpy
and the bundled scipy. If that fails, the first step stays, and the sidebar shows the error.
"""

import traceback
from collections.abc import Callable, Sequence
from functools import partial
from types import ModuleType
from typing import Any

import bpy

from .preferences import diagnostics, preferences
from .preferences.sidebar_tab import SidebarPanel, register_panel, unregister_panel

_KINDS = (
    bpy.types.AddonPreferences,
    bpy.types.Menu,
    bpy.types.Operator,
    bpy.types.Panel,
    bpy.types.PropertyGroup,
    bpy.types.UIList,
)


def _first_modules() -> Sequence[ModuleType]:
    """Import the modules that need no library."""
    from .preferences import diagnostics_ui

    return preferences, diagnostics_ui


def _other_modules() -> Sequence[ModuleType]:
    """Import the other modules, in the order of registration."""
    import scipy  # noqa: F401  # fails here if its wheel is broken, before anything is registered

    from .character import bone_map_settings
    from .jobs import activity
    from .operators import (
        batch,
        cameras,
        capture,
        character,
        command_line,
        database,
        export_take,
        jobs,
        put_on_character,
        self_test,
        solve_takes,
        subject,
        take_files,
    )
    from .operators import targets as target_operators
    from .panels import batch as panel_batch
    from .panels import camera_controls, steps, targets, vmc
    from .panels import capture as panel_capture
    from .panels import character as panel_character
    from .panels import takes as panel_takes
    from .preferences import new_file_defaults
    from .settings import batch_settings, capture_settings, result_settings, target_settings, vmc_input, vmc_output

    return (
        bone_map_settings,
        capture_settings,
        target_settings,
        vmc_output,
        vmc_input,
        result_settings,
        batch_settings,
        jobs,
        cameras,
        subject,
        database,
        character,
        capture,
        put_on_character,
        solve_takes,
        export_take,
        take_files,
        target_operators,
        batch,
        self_test,
        new_file_defaults,
        panel_character,
        steps,
        camera_controls,
        panel_capture,
        vmc,
        targets,
        panel_takes,
        panel_batch,
        command_line,
        activity,  # unregistered first, so that it ends running work while the rest is still there
    )


def _fallback_modules() -> Sequence[ModuleType]:
    """Import the modules for an installation with a broken library."""
    from .panels import broken_installation

    return (broken_installation,)


_undo: list[Callable[[], None]] = []


def register() -> None:
    """Register everything; with a broken library, preferences and diagnostics only."""
    _add_all(_first_modules())
    diagnostics.problem = ""
    count = len(_undo)
    try:
        _add_all(_other_modules())
    except Exception as error:  # a broken library may raise anything
        traceback.print_exc()
        _remove_down_to(count)
        name = error.name if isinstance(error, ImportError) else None
        diagnostics.problem = f"{name or 'a library'} cannot be loaded: {error}"
        _add_all(_fallback_modules())


def unregister() -> None:
    """Undo `register` in reverse order."""
    _remove_down_to(0)


def _add_all(modules: Sequence[ModuleType]) -> None:
    """Register modules in order: the classes of each, then its own additions."""
    for module in modules:
        for cls in _classes(module):
            if issubclass(cls, SidebarPanel):
                register_panel(cls, preferences.tab(bpy.context))
                _undo.append(partial(unregister_panel, cls))
            else:
                bpy.utils.register_class(cls)
                _undo.append(partial(bpy.utils.unregister_class, cls))
        if hasattr(module, "register"):
            module.register()
        if hasattr(module, "unregister"):
            _undo.append(module.unregister)


def _classes(module: ModuleType) -> list[Any]:
    """Return the classes of Blender's kinds that a module defines, in their order."""
    found = [value for value in vars(module).values() if isinstance(value, type) and issubclass(value, _KINDS)]
    return [cls for cls in found if cls.__module__ == module.__name__]


def _remove_down_to(count: int) -> None:
    while len(_undo) > count:
        _undo.pop()()
