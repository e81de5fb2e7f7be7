"""Adjustments of a character shown on its animation while they are changed."""

import bpy

from ...core.errors import PerfanimError
from ..animation.character_action import keyed_action, readjust_action
from ..character.bone_map_settings import adjusted_listeners
from ..jobs import activity

PANEL = "character"


def _show(armature_object: bpy.types.Object) -> None:
    """Change the keys of the active action. A running capture looks at the adjustments itself."""
    if activity.current() is not None or keyed_action(armature_object) is None:
        return
    try:
        readjust_action(armature_object)
    except PerfanimError as error:
        activity.set_message(PANEL, str(error), "ERROR")


def register() -> None:
    """Add the listener."""
    adjusted_listeners.append(_show)


def unregister() -> None:
    """Remove the listener."""
    adjusted_listeners.remove(_show)
