"""Settings for new files, taken from the preferences."""

import bpy

from ...core.markers.marker_set import marker_set_names
from . import preferences


@bpy.app.handlers.persistent
def _set_up_new_file(*_: object) -> None:
    """Set marker set and database of an unsaved file if they are not set."""
    chosen = preferences.chosen(bpy.context)
    if chosen is None or bpy.data.filepath:
        return
    for scene in bpy.data.scenes:
        settings = scene.perfanim
        if chosen.marker_set in marker_set_names() and not settings.is_property_set("marker_set"):
            settings.marker_set = chosen.marker_set
        if chosen.database and not settings.is_property_set("database"):
            settings.database = chosen.database


def register() -> None:
    """Add the handler, and set up the open file."""
    bpy.app.handlers.load_post.append(_set_up_new_file)
    if hasattr(bpy.data, "scenes"):  # not while Blender starts: the handler runs later
        _set_up_new_file()


def unregister() -> None:
    """Remove the handler."""
    bpy.app.handlers.load_post.remove(_set_up_new_file)
