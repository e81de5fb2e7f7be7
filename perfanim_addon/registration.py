"""Registration in two steps.

First what explains a broken installation (preferences, diagnostics), with nothing but Blender and the standard
library; then the rest, which needs numpy and the bundled scipy. If that fails, the first step stays, and the sidebar
says what is wrong.
"""

import importlib
import traceback
from types import ModuleType

from . import diagnostics

_FIRST = ("translations", "preferences", "diagnostics_ui")
_REST = (
    "bone_list",
    "properties",
    "targets",
    "sending",
    "receiving",
    "result",
    "batch_settings",
    "operators.jobs",
    "operators.cameras",
    "operators.subject",
    "operators.database",
    "operators.character",
    "operators.capture",
    "operators.takes",
    "operators.take_files",
    "operators.targets",
    "operators.batch",
    "operators.self_test",
    "defaults",
    "panel_character",
    "panels",
    "panel_targets",
    "panel_takes",
    "panel_batch",
    "command_line",
    "running",  # last, so that it ends what runs while all that this needs is still there
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
    except Exception as error:  # a broken library may raise anything
        traceback.print_exc()
        _remove_down_to(count)
        name = error.name if isinstance(error, ImportError) else None
        diagnostics.problem = f"{name or 'a library'} cannot be loaded: {error}"
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
