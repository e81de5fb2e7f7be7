"""Further targets of a capture: props, and the objects that follow them. Kept in the scene."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy

from ..core.assets import PROPS
from ..core.errors import CharacterError, PerfanimError
from ..core.prop import Prop, check_together
from . import states
from .place import absolute
from .prop_mesh import add_prop_object

SHIPPED = str(PROPS / "sword.toml")  # what is meant where no definition is chosen


class PERFANIM_PG_target(bpy.types.PropertyGroup):
    """A prop and the object that follows it."""

    definition: bpy.props.StringProperty(
        name="Definition",
        description="Measured prop (TOML); empty: the sword that the simulated performer carries",
        subtype="FILE_PATH",
    )
    object: bpy.props.PointerProperty(
        name="Object",
        description="Object that follows the prop, upright along its Z axis; empty: a simple one is added",
        type=bpy.types.Object,
        poll=lambda _self, candidate: candidate.type != "ARMATURE",
    )


class PERFANIM_PG_targets(bpy.types.PropertyGroup):
    """The list of further targets."""

    entries: bpy.props.CollectionProperty(
        name="Further Targets", description="Props that are followed besides the performer", type=PERFANIM_PG_target
    )
    active: bpy.props.IntProperty(name="Target", description="The target that the fields below are about")


def path_of(entry: PERFANIM_PG_target) -> str:
    """Return the file of a target's definition."""
    return absolute(entry.definition) or SHIPPED


def found_prop(entry: PERFANIM_PG_target) -> Prop | PerfanimError:
    """Return a target's prop, or what is wrong with its definition."""
    return states.prop(path_of(entry))


def title(entry: PERFANIM_PG_target) -> str:
    """Return what a target is called in the list."""
    prop = found_prop(entry)
    return prop.name if isinstance(prop, Prop) else Path(path_of(entry)).stem


def problem(scene: bpy.types.Scene) -> str:
    """Return why the targets cannot be followed, "" when they can; quick enough for drawing."""
    try:
        check_together(props(scene))
        for entry in scene.perfanim_targets.entries:
            check_object(entry.object)
    except PerfanimError as error:
        return str(error)
    return ""


def check_object(target: bpy.types.Object | None) -> None:
    """Raise CharacterError for an object that cannot be moved freely."""
    if target is None:
        return
    reason, advice = "", ""
    if target.library is not None:
        reason, advice = "is linked from another file", "make a library override of it"
    elif target.parent is not None:
        reason, advice = "is moved by its parent", "clear the parent (Alt P), or choose the parent"
    if reason:
        raise CharacterError(f"{reason} and cannot follow a prop", where=target.name, advice=advice)


def props(scene: bpy.types.Scene) -> list[Prop]:
    """Return the props of a scene's targets.

    Raises:
        PerfanimError: a definition is missing or bad.
    """
    found = []
    for entry in scene.perfanim_targets.entries:
        prop = found_prop(entry)
        if isinstance(prop, PerfanimError):
            raise prop
        found.append(prop)
    return found


def object_of(context: bpy.types.Context, prop: Prop) -> str:
    """Return the name of the object that follows a prop; where none is chosen, a simple one is made."""
    entry = next(_of(context.scene, prop.name), None)
    if entry is not None and entry.object is not None:
        return str(entry.object.name)
    made = add_prop_object(context, prop)
    if entry is not None:
        entry.object = made
    return str(made.name)


def _of(scene: bpy.types.Scene, name: str) -> Iterator[Any]:
    for entry in scene.perfanim_targets.entries:
        prop = found_prop(entry)
        if isinstance(prop, Prop) and prop.name == name:
            yield entry


def register() -> None:
    """Register the list and hang it on the scene."""
    for cls in (PERFANIM_PG_target, PERFANIM_PG_targets):
        bpy.utils.register_class(cls)
    bpy.types.Scene.perfanim_targets = bpy.props.PointerProperty(type=PERFANIM_PG_targets)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.Scene.perfanim_targets
    for cls in (PERFANIM_PG_targets, PERFANIM_PG_target):
        bpy.utils.unregister_class(cls)
