"""Perfanim: a full-body character from a few markers and ordinary cameras.

This folder is a Blender extension and an ordinary Python package at once, so nothing of Blender is imported here, and
nothing slow: the functions of `__all__` are loaded when they are first used.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .core.api import *

__all__ = [
    "BuildSettings",
    "PerfanimError",
    "RetargetRequest",
    "Session",
    "SolveRequest",
    "SolvedTake",
    "build_database",
    "calibrate_cameras",
    "calibrate_subject",
    "evaluate",
    "fit_subject",
    "load_motion",
    "load_recording",
    "load_subject",
    "load_take",
    "open_database",
    "retarget",
    "solve",
]


def __getattr__(name: str) -> object:
    """Return a public name of the library."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .core import api

    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def register() -> None:
    """Called by Blender when the extension is switched on."""
    from . import perfanim_addon

    perfanim_addon.register()


def unregister() -> None:
    """Called by Blender when the extension is switched off."""
    from . import perfanim_addon

    perfanim_addon.unregister()
