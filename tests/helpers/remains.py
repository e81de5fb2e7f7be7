"""What an add-on can leave behind in Blender, to be compared before and after."""

import os
import sys
import threading
from pathlib import Path
from typing import Any

import bpy

OURS = "perfanim"
KINDS = (
    "Panel",
    "Operator",
    "UIList",
    "Menu",
    "Header",
    "PropertyGroup",
    "AddonPreferences",
    "Gizmo",
    "GizmoGroup",
    "KeyingSetInfo",
)


def remains() -> dict[str, Any]:
    """Everything that hangs on Blender and Python, in a form that JSON can hold."""
    found = {
        "handlers": _handlers(),
        "types": [name for name in dir(bpy.types) if OURS in name.lower()],
        "operators": dir(bpy.ops.perfanim),
        "properties": _properties(),
        "classes": _classes(),
        "drawn": _drawn(),
        "timers": _timers(),
        "keys": _keys(),
        "threads": sorted(thread.name for thread in threading.enumerate()),
        "processes": children(),
        "images": [image.name for image in bpy.data.images if OURS in image.name.lower()],
    }
    return {key: value for key, value in found.items() if value}


def children() -> list[int]:
    """Processes that this one has started and that are there still; Linux only, elsewhere none."""
    tasks = Path(f"/proc/{os.getpid()}/task")
    lists = [path.read_text().split() for path in tasks.glob("*/children")]
    return sorted(int(child) for line in lists for child in line)


def _handlers() -> dict[str, list[str]]:
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    return {
        name: [f"{f.__module__}.{f.__qualname__}" for f in functions]
        for name, functions in lists.items()
        if isinstance(functions, list) and functions
    }


def _properties() -> list[str]:
    """Properties of ours on Blender's own types, and anything else that hangs there."""
    types = {name: getattr(bpy.types, name) for name in dir(bpy.types) if not name.startswith("_")}
    return sorted(f"{name}.{each}" for name, cls in types.items() for each in vars(cls) if OURS in each)


def _classes() -> list[str]:
    found = []
    for kind in KINDS:
        waiting = list(getattr(bpy.types, kind).__subclasses__())
        while waiting:
            cls = waiting.pop()
            waiting += cls.__subclasses__()
            if getattr(cls, "is_registered", False) and OURS in cls.__name__.lower():
                found.append(cls.__name__)
    return sorted(set(found))


def _drawn() -> list[str]:
    """Functions that were appended to panels and menus."""
    found = []
    for name in dir(bpy.types):
        for function in getattr(getattr(getattr(bpy.types, name), "draw", None), "_draw_funcs", ()):
            if OURS in function.__module__:
                found.append(f"{name}: {function.__module__}.{function.__qualname__}")
    return found


def _timers() -> list[str]:
    """Functions of our modules that `bpy.app.timers` will call."""
    found = []
    for module in list(sys.modules.values()):
        name = getattr(module, "__name__", "")
        if OURS in name and "perfanim_addon" in name:
            functions = [f for f in vars(module).values() if callable(f) and not isinstance(f, type)]
            found += [f"{name}.{f.__name__}" for f in functions if _waits(f)]
    return sorted(set(found))


def _waits(function: Any) -> bool:
    return hasattr(function, "__name__") and bpy.app.timers.is_registered(function)


def _keys() -> list[str]:
    configurations = bpy.context.window_manager.keyconfigs
    maps = configurations.addon.keymaps if configurations.addon else ()
    return sorted(item.idname for each in maps for item in each.keymap_items if OURS in item.idname)
