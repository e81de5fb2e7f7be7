"""Registration in two steps.

Preferences and diagnostics come first and need only Blender and the standard library; the rest needs numpy and the
bundled OpenCV. If the rest fails, the first step remains, and the sidebar shows the error.
"""

import traceback
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

import bpy

from .panels import broken_installation
from .preferences import diagnostics, diagnostics_ui, manual, preferences
from .preferences.paths import clean_up
from .preferences.property_kinds import attach
from .preferences.sidebar_tab import SidebarPanel, register_panel, unregister_panel

_KINDS = (
    bpy.types.AddonPreferences,
    bpy.types.FileHandler,
    bpy.types.Menu,
    bpy.types.Operator,
    bpy.types.Panel,
    bpy.types.PropertyGroup,
    bpy.types.UIList,
)
_PANELS = (  # in the order of the sidebar
    "guide_panel",
    "character_panel",
    "step_panels",
    "hands_panel",
    "capture_panel",
    "targets_panel",
    "takes_panel",
    "clean_up_panel",
    "sketch_panel",
    "batch_panel",
    "alignment",
)


def _other_modules() -> Sequence[ModuleType]:
    """Import the other modules, in the order of registration."""
    import cv2  # noqa: F401  # a broken wheel fails here, before anything is registered

    from . import operators, settings
    from .character import bone_map_settings
    from .jobs import activity
    from .preferences import new_file_defaults
    from .viewport import ghost

    panels = [import_module(f".panels.{name}", __package__) for name in _PANELS]
    # activity is unregistered first, so that running work ends while the rest is still registered
    modules = (bone_map_settings, *_modules_of(settings), *_modules_of(operators), new_file_defaults, ghost, *panels)
    return (*modules, activity)


def _modules_of(package: ModuleType) -> list[ModuleType]:
    """Import and return all modules of a package."""
    return [import_module(f"{package.__name__}.{found.name}") for found in iter_modules(package.__path__)]


_undo: list[Callable[[], None]] = []


def register() -> None:
    """Register everything; if a library is broken, only preferences and diagnostics."""
    _add_all((preferences, diagnostics_ui, manual))
    diagnostics.problem = ""
    count = len(_undo)
    try:
        _add_all(_other_modules())
        clean_up()
    except Exception as error:  # a broken library may raise any exception
        traceback.print_exc()
        _remove_down_to(count)
        name = error.name if isinstance(error, ImportError) else None
        diagnostics.problem = f"{name or 'a library'} cannot be loaded: {error}"
        _add_all((broken_installation,))


def unregister() -> None:
    """Undo `register` in reverse order."""
    _remove_down_to(0)


def _add_all(modules: Sequence[ModuleType]) -> None:
    """Register modules in order: the classes of each, then its own additions."""
    for module in modules:
        found = [value for value in vars(module).values() if isinstance(value, type) and issubclass(value, _KINDS)]
        for cls in [cls for cls in found if cls.__module__ == module.__name__]:
            if issubclass(cls, SidebarPanel):
                register_panel(cls, preferences.tab(bpy.context))
                _undo.append(partial(unregister_panel, cls))
            else:
                bpy.utils.register_class(cls)
                _undo.append(partial(bpy.utils.unregister_class, cls))
            if hasattr(cls, "attached_to"):
                _undo.append(attach(cls))
        if hasattr(module, "register"):
            module.register()
        if hasattr(module, "unregister"):
            _undo.append(module.unregister)


def _remove_down_to(count: int) -> None:
    while len(_undo) > count:
        _undo.pop()()
