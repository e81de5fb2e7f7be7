"""Registration of property groups on Blender's data types."""

from collections.abc import Callable

import bpy

_Step = Callable[[], None]


def attach_property_group(
    owner: type[bpy.types.bpy_struct], name: str, *classes: type[bpy.types.PropertyGroup]
) -> tuple[_Step, _Step]:
    """Return the functions `register` and `unregister` of a module with settings.

    Args:
        owner: data type that gets the settings.
        classes: to register, in this order; the last is the property's type.
    """
    register_classes, unregister_classes = bpy.utils.register_classes_factory(classes)

    def register() -> None:
        """Register the classes and attach the settings."""
        register_classes()
        setattr(owner, name, bpy.props.PointerProperty(type=classes[-1]))

    def unregister() -> None:
        """Undo `register`."""
        delattr(owner, name)
        unregister_classes()

    return register, unregister
