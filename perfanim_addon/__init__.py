"""The Blender side: thin operators and panels over `core`."""

from . import registration


def register() -> None:
    """Register all classes, properties and handlers."""
    registration.register()


def unregister() -> None:
    """Undo `register` in reverse order."""
    registration.unregister()
