"""Kinds of properties that settings and operators share, and their layout."""

from collections.abc import Callable, Iterable
from typing import Any

import bpy

_LARGEST = 2**31 - 1  # largest integer in Blender
HIDDEN = {"HIDDEN", "SKIP_SAVE"}  # options for a property that only the button sets


def switch(name: str, description: str, default: bool = False, **more: Any) -> Any:
    """Return a boolean property."""
    return bpy.props.BoolProperty(name=name, description=description, default=default, **more)


def number(name: str, description: str, default: float, least: float, most: float, **more: Any) -> Any:
    """Return a float property within bounds."""
    return bpy.props.FloatProperty(name=name, description=description, default=default, min=least, max=most, **more)


def string(name: str, description: str, default: str = "", **more: Any) -> Any:
    """Return a text property."""
    return bpy.props.StringProperty(name=name, description=description, default=default, **more)


def whole_number(name: str, description: str, default: int, least: int, most: int = _LARGEST, **more: Any) -> Any:
    """Return an integer property within bounds."""
    return bpy.props.IntProperty(name=name, description=description, default=default, min=least, max=most, **more)


def duration(name: str, description: str, default: float, least: float, most: float) -> Any:
    """Return a property for a time in seconds."""
    return number(name, description, default, least, most, subtype="TIME_ABSOLUTE")


def choice(name: str, description: str, items: Any, default: Any = None, **more: Any) -> Any:
    """Return a choice among items; by default the first."""
    return bpy.props.EnumProperty(name=name, description=description, items=items, default=default, **more)


def dynamic_choice(name: str, description: str, items: Callable[[Any], Iterable[Any]]) -> Any:
    """Return a choice among items listed by a function of the context."""
    kept: list[Any] = []  # Blender does not hold references to the items' texts

    def listed(_self: object, context: Any) -> list[Any]:
        kept[:] = items(context)
        return kept

    return choice(name, description, listed)


def pointer(name: str, description: str, kind: Any, **more: Any) -> Any:
    """Return a property that refers to a data-block or holds a group."""
    return bpy.props.PointerProperty(name=name, description=description, type=kind, **more)


def collection(name: str, description: str, kind: Any) -> Any:
    """Return a list of property groups."""
    return bpy.props.CollectionProperty(name=name, description=description, type=kind)


def file_path(name: str, description: str) -> Any:
    """Return a property for a file."""
    return string(name, description, subtype="FILE_PATH")


def folder_path(name: str, description: str) -> Any:
    """Return a property for a folder."""
    return string(name, description, subtype="DIR_PATH")


def attach(group: type[bpy.types.PropertyGroup]) -> Callable[[], None]:
    """Attach a registered group to the data type in its `attached_to`; return the function that detaches it."""
    owner, name = group.attached_to
    setattr(owner, name, bpy.props.PointerProperty(type=group))
    return lambda: delattr(owner, name)


def draw_props(layout: bpy.types.UILayout, owner: Any, *names: str) -> None:
    """Draw properties of a group or an operator, one per row."""
    for name in names:
        layout.prop(owner, name)


def draw_rate(layout: bpy.types.UILayout, owner: Any, name: str) -> None:
    """Draw a rate, for which 0 means that of the cameras or the take themselves."""
    layout.prop(owner, name, text="Rate (Hz)" if getattr(owner, name) else "Rate (0: own)")


def property_column(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """Add a column of properties with their names on the left."""
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column
