"""Additional targets of a capture, stored in the scene: props and performers."""

from collections.abc import Sequence
from pathlib import Path

import bpy

from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import CharacterError, PerfanimError, SettingsError, SubjectError
from ...core.markers.marker_set import MarkerSet
from ...core.markers.prop import Prop, check_distinct
from ...core.markers.subject import Subject
from ...core.system.assets import PROPS
from ..character.posing import map_problem
from ..character.prop_mesh import add_prop_object
from ..preferences.attach_settings import attach_property_group
from ..preferences.paths import absolute
from ..preferences.property_kinds import choice, file_path
from . import readiness
from .capture_settings import find_bones, is_armature

SHIPPED = str(PROPS / "sword.toml")  # default definition
SIMULATED_HEIGHT_M = 1.75

_KINDS = (
    ("PROP", "Prop", "Rigid object with its own markers, such as a sword, a stick or a camera"),
    ("PERFORMER", "Performer", "Another performer with another character"),
)


class PERFANIM_PG_target(bpy.types.PropertyGroup):
    """A prop with its object, or a further performer with their character."""

    kind: choice("Kind", "Kind of target", _KINDS)
    definition: file_path("Definition", "Measured prop (TOML); empty for the simulated performer's sword")
    object: bpy.props.PointerProperty(
        name="Object",
        description="Object that follows the prop, upright along its Z axis; empty adds a simple one",
        type=bpy.types.Object,
        poll=lambda _self, candidate: candidate.type != "ARMATURE",
    )
    subject: file_path("Subject", "Calibrated performer (TOML); empty for another simulated performer")
    armature: bpy.props.PointerProperty(
        name="Armature",
        description="Armature that follows this performer; empty adds a new character at the start",
        type=bpy.types.Object,
        poll=is_armature,
        update=find_bones,
    )


class PERFANIM_PG_targets(bpy.types.PropertyGroup):
    """The list of further targets."""

    entries: bpy.props.CollectionProperty(
        name="Additional Targets", description="Props and performers besides the first", type=PERFANIM_PG_target
    )
    active: bpy.props.IntProperty(name="Target", description="Target shown below the list")


def of_kind(scene: bpy.types.Scene, kind: str) -> list[PERFANIM_PG_target]:
    """Return a scene's targets of one kind, in their order."""
    return [entry for entry in scene.perfanim_targets.entries if entry.kind == kind]


def path_of(entry: PERFANIM_PG_target) -> str:
    """Return the file of a target's definition."""
    return absolute(entry.definition) or SHIPPED


def found_prop(entry: PERFANIM_PG_target) -> Prop | PerfanimError:
    """Return a target's prop, or the error in its definition."""
    return readiness.prop(path_of(entry))


def found_subject(entry: PERFANIM_PG_target) -> Subject | PerfanimError:
    """Return a further performer with all calibrated markers, or the error."""
    if entry.subject:
        return readiness.subject(absolute(entry.subject))
    scene, chosen = entry.id_data, entry.id_data.perfanim
    if not readiness.is_known(chosen):
        return SubjectError(
            "a further performer is not calibrated", advice="choose the subject under Additional Targets"
        )
    markers: MarkerSet | PerfanimError = readiness.marker_set(chosen)
    if isinstance(markers, PerfanimError):
        return markers
    number = of_kind(scene, "PERFORMER").index(entry) + 2
    return Subject(f"Performer {number}", default_skeleton(SIMULATED_HEIGHT_M), markers)


def title(entry: PERFANIM_PG_target) -> str:
    """Return the title of a target in the list."""
    if entry.kind == "PERFORMER":
        subject = found_subject(entry)
        return subject.name if isinstance(subject, Subject) else Path(entry.subject).stem or "Performer"
    prop = found_prop(entry)
    return prop.name if isinstance(prop, Prop) else Path(path_of(entry)).stem


def problem(scene: bpy.types.Scene) -> str:
    """Return the first problem of the targets, "" for none; quick enough for drawing."""
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
    return [readiness.good(found_prop(entry)) for entry in of_kind(scene, "PROP")]


def performers(scene: bpy.types.Scene) -> list[Subject]:
    """Return the further performers of a scene's targets.

    Raises:
        PerfanimError: one is not calibrated, their character cannot be driven, or there is one camera only.
    """
    found, driven = [], {scene.perfanim.armature} - {None}
    for entry in of_kind(scene, "PERFORMER"):
        found.append(readiness.good(found_subject(entry)))
        if entry.armature in driven:
            advice = "choose another under Additional Targets, or none for a new character"
            raise CharacterError("cannot follow two performers", where=entry.armature.name, advice=advice)
        if entry.armature is not None:
            driven.add(entry.armature)
            reason = map_problem(entry.armature)
            if reason:
                raise CharacterError(reason, where=entry.armature.name)
    if found and (readiness.is_one_camera(scene.perfanim) or not readiness.has_cameras(scene.perfanim)):
        what = "one camera cannot" if readiness.has_cameras(scene.perfanim) else "trackers cannot"
        raise SettingsError(f"{what} tell several performers apart", advice="use two cameras")
    return found


def object_of(context: bpy.types.Context, prop: Prop) -> str:
    """Return the name of the object that follows a prop; add one if none is chosen."""
    found = ((entry, found_prop(entry)) for entry in of_kind(context.scene, "PROP"))
    entry = next((entry for entry, own in found if isinstance(own, Prop) and own.name == prop.name), None)
    if entry is not None and entry.object is not None:
        return str(entry.object.name)
    made = add_prop_object(context, prop)
    if entry is not None:
        entry.object = made
    return str(made.name)


def meant_for(scene: bpy.types.Scene, names: Sequence[str]) -> list[int | None]:
    """Return the target index of each named performer: by name, the rest in order."""
    entries = scene.perfanim_targets.entries
    free = [index for index, entry in enumerate(entries) if entry.kind == "PERFORMER"]
    meant: list[int | None] = []
    for name in names:
        found = next((index for index in free if title(entries[index]) == name), None)
        meant.append(found)
        free = [index for index in free if index != found]
    return [free.pop(0) if found is None and free else found for found in meant]


register, unregister = attach_property_group(bpy.types.Scene, "perfanim_targets", PERFANIM_PG_targets)
