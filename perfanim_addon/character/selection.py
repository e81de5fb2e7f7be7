"""Selection of objects."""

from collections.abc import Sequence

import bpy


def leave_modes(context: bpy.types.Context) -> None:
    """Switch to Object Mode."""
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def select_only(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> None:
    """Select only these objects and make the first one active."""
    for each in context.view_layer.objects:
        each.select_set(each in objects)
    context.view_layer.objects.active = objects[0]
