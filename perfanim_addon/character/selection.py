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


def active_armatures(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the armature of the active object or its parents, or those of its children.

    Importers leave a mesh or an empty of the character active.
    """
    active = context.object
    if active is None:
        return []
    above = active
    while above is not None:
        found = above if above.type == "ARMATURE" else above.find_armature()
        if found is not None:
            return [found]
        above = above.parent
    return [obj for obj in active.children_recursive if obj.type == "ARMATURE"]
