"""Further targets of a capture, kept in the scene: props with the objects that follow them, further performers with
their characters.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import bpy

from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import CharacterError, PerfanimError, SettingsError, SubjectError
from ...core.markers.marker_set import MarkerSet
from ...core.markers.prop import Prop, check_distinct
from ...core.markers.subject import Subject
from ...core.system.assets import PROPS
from ..character.posing import map_problem
from ..character.prop_mesh import add_prop_object
from ..preferences.paths import absolute
from . import readiness
from .capture_settings import find_bones, is_armature

SHIPPED = str(PROPS / "sword.toml")  # what is meant where no definition is chosen
SIMULATED_HEIGHT_M = 1.75

_KINDS = (
    ("PROP", "Prop", "A rigid thing with markers of its own: a sword, a stick, a camera"),
    ("PERFORMER", "Performer", "Somebody who performs beside the first, and moves a character of their own"),
)


class PERFANIM_PG_target(bpy.types.PropertyGroup):
    """A prop and the object that follows it, or a further performer and the character that moves along."""

    kind: bpy.props.EnumProperty(name="Kind", description="What is followed", items=_KINDS)
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
    subject: bpy.props.StringProperty(
        name="Subject",
        description="Calibrated performer with the markers worn (TOML); empty: another simulated performer",
        subtype="FILE_PATH",
    )
    armature: bpy.props.PointerProperty(
        name="Armature",
        description="Armature that moves along with this performer; empty: a new character is added at the start",
        type=bpy.types.Object,
        poll=is_armature,
        update=find_bones,
    )


class PERFANIM_PG_targets(bpy.types.PropertyGroup):
    """The list of further targets."""

    entries: bpy.props.CollectionProperty(
        name="Further Targets",
        description="Props and further performers, who are followed besides the first",
        type=PERFANIM_PG_target,
    )
    active: bpy.props.IntProperty(name="Target", description="The target that the fields below are about")


def of_kind(scene: bpy.types.Scene, kind: str) -> list[PERFANIM_PG_target]:
    """Return a scene's targets of one kind, in their order."""
    return [entry for entry in scene.perfanim_targets.entries if entry.kind == kind]


def path_of(entry: PERFANIM_PG_target) -> str:
    """Return the file of a target's definition."""
    return absolute(entry.definition) or SHIPPED


def found_prop(entry: PERFANIM_PG_target) -> Prop | PerfanimError:
    """Return a target's prop, or what is wrong with its definition."""
    return readiness.prop(path_of(entry))


def found_subject(entry: PERFANIM_PG_target) -> Subject | PerfanimError:
    """Return who a further performer is, with all markers of their calibration, or why nobody knows."""
    if entry.subject:
        return readiness.subject(absolute(entry.subject))
    scene, chosen = entry.id_data, entry.id_data.perfanim
    if not readiness.is_known(chosen):
        return SubjectError("a further performer is not calibrated", advice="choose the subject under Further Targets")
    markers: MarkerSet | PerfanimError = readiness.marker_set(chosen)
    if isinstance(markers, PerfanimError):
        return markers
    number = of_kind(scene, "PERFORMER").index(entry) + 2
    return Subject(f"Performer {number}", default_skeleton(SIMULATED_HEIGHT_M), markers)


def title(entry: PERFANIM_PG_target) -> str:
    """Return what a target is called in the list."""
    if entry.kind == "PERFORMER":
        subject = found_subject(entry)
        return subject.name if isinstance(subject, Subject) else Path(entry.subject).stem or "Performer"
    prop = found_prop(entry)
    return prop.name if isinstance(prop, Prop) else Path(path_of(entry)).stem


def problem(scene: bpy.types.Scene) -> str:
    """Return why the targets cannot be followed, "" when they can; quick enough for drawing."""
    try:
        check_distinct(props(scene))
        for entry in of_kind(scene, "PROP"):
            check_object(entry.object)
        performers(scene)
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
    for entry in of_kind(scene, "PROP"):
        prop = found_prop(entry)
        if isinstance(prop, PerfanimError):
            raise prop
        found.append(prop)
    return found


def performers(scene: bpy.types.Scene) -> list[Subject]:
    """Return the further performers of a scene's targets.

    Raises:
        PerfanimError: one is not calibrated, their character cannot be driven, or one camera is to tell them apart.
    """
    found, driven = [], {scene.perfanim.armature} - {None}
    for entry in of_kind(scene, "PERFORMER"):
        subject = found_subject(entry)
        if isinstance(subject, PerfanimError):
            raise subject
        if entry.armature in driven:
            advice = "choose another under Further Targets, or none for a new character"
            raise CharacterError("cannot follow two performers", where=entry.armature.name, advice=advice)
        if entry.armature is not None:
            driven.add(entry.armature)
            reason = map_problem(entry.armature)
            if reason:
                raise CharacterError(reason, where=entry.armature.name)
        found.append(subject)
    if found and (readiness.is_one_camera(scene.perfanim) or not readiness.has_cameras(scene.perfanim)):
        what = "one camera cannot" if readiness.has_cameras(scene.perfanim) else "trackers cannot"
        raise SettingsError(f"{what} tell several performers apart", advice="use two cameras")
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
    for entry in of_kind(scene, "PROP"):
        prop = found_prop(entry)
        if isinstance(prop, Prop) and prop.name == name:
            yield entry


def meant_for(scene: bpy.types.Scene, names: Sequence[str]) -> list[int | None]:
    """Return for each further performer of these names which target is meant: by the name, the rest in their order."""
    entries = scene.perfanim_targets.entries
    free = [index for index, entry in enumerate(entries) if entry.kind == "PERFORMER"]
    meant: list[int | None] = []
    for name in names:
        found = next((index for index in free if title(entries[index]) == name), None)
        meant.append(found)
        free = [index for index in free if index != found]
    return [free.pop(0) if found is None and free else found for found in meant]


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
