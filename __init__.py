"""Perfanim: a full-body character from a few markers and ordinary cameras.

This folder is a Blender extension and an ordinary Python package at once, so nothing of Blender is imported here;
`core` works without it.
"""


def register() -> None:
    """Called by Blender when the extension is switched on."""
    from . import perfanim_addon

    perfanim_addon.register()


def unregister() -> None:
    """Called by Blender when the extension is switched off."""
    from . import perfanim_addon

    perfanim_addon.unregister()
