"""Registration in two steps.

First what explains a broken installation (preferences, diagnostics), with nothing but Blender and the standard
library; then the rest, which needs numpy and the bundled scipy. If that fails, the first step stays, and the sidebar
says what is wrong.
"""

import importlib
from types import ModuleType

from . import diagnostics

_FIRST = ("preferences", "diagnostics_ui")
_REST = (
    "running",
    "bone_list",
    "properties",
    "result",
    "operators.jobs",
    "operators.cameras",
    "operators.subject",
    "operators.database",
    "operators.character",
    "operators.capture",
    "operators.takes",
    "panel_character",
    "panels",
    "panel_takes",
)
_FALLBACK = ("panel_broken",)

_registered: list[ModuleType] = []


def register() -> None:
    """Register what can be registered; a failing library leaves preferences and diagnostics usable."""
    _add_all(_FIRST)
    diagnostics.problem = ""
    count = len(_registered)
    try:
        importlib.import_module("scipy")
        _add_all(_REST)
    except ImportError as error:
        _remove_down_to(count)
        diagnostics.problem = f"{error.name or 'a library'} cannot be loaded: {error}"
        _add_all(_FALLBACK)


def unregister() -> None:
    """Undo `register` in reverse order."""
    _remove_down_to(0)


def _add_all(names: tuple[str, ...]) -> None:
    for name in names:
        module = importlib.import_module(f".{name}", __package__)
        module.register()
        _registered.append(module)


def _remove_down_to(count: int) -> None:
    while len(_registered) > count:
        _registered.pop().unregister()
