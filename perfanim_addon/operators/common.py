"""What all operators share: how they refuse and how they report."""

import bpy

from ...core.errors import PerfanimError
from ..jobs import activity


def idle(operator: type[bpy.types.Operator]) -> bool:
    """For `poll`: whether nothing else runs; says so on the greyed button."""
    if activity.current() is not None:
        operator.poll_message_set("Something is running: wait for its end, or stop it")
        return False
    return True


def in_scene(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """For `poll`: whether there is a window and a scene that may be changed."""
    if context.window is None or context.scene is None:
        operator.poll_message_set("Needs a window with a scene")
        return False
    if not context.scene.is_editable:
        operator.poll_message_set("The scene is linked from another file and cannot be changed")
        return False
    return True


def failed(operator: bpy.types.Operator, panel: str, error: PerfanimError) -> set[str]:
    """Report an error, keep it for the panel, and cancel."""
    text = str(error)
    activity.set_message(panel, text, "ERROR")
    operator.report({"ERROR"}, text)
    return {"CANCELLED"}
