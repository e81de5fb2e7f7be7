"""Settings attached to Blender's data types."""

from collections.abc import Callable

import bpy

_Step = Callable[[], None]


def attach_property_group(
    owner: type[bpy.types.bpy_struct], name: str, group: type[bpy.types.PropertyGroup]
) -> tuple[_Step, _Step]:
    """Return `register` and `unregister` of a module with settings of an `owner` type."""

    def register() -> None:
        setattr(owner, name, bpy.props.PointerProperty(type=group))

    def unregister() -> None:
        delattr(owner, name)

    return register, unregister
