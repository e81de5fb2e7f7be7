"""Settings of the add-on that hang on Blender's own data."""

from collections.abc import Callable

import bpy

_Step = Callable[[], None]


def hung_on(owner: type[bpy.types.ID], name: str, *classes: type[bpy.types.PropertyGroup]) -> tuple[_Step, _Step]:
    """Return the functions `register` and `unregister` of a module.

    Args:
        owner: the kind of data that gets the settings.
        name: what they are called there.
        classes: to register, in this order; the last has the settings.
    """
    register_classes, unregister_classes = bpy.utils.register_classes_factory(classes)

    def register() -> None:
        """Register the settings and hang them on Blender's data."""
        register_classes()
        setattr(owner, name, bpy.props.PointerProperty(type=classes[-1]))

    def unregister() -> None:
        """Undo `register`."""
        delattr(owner, name)
        unregister_classes()

    return register, unregister
