"""Additional targets of a capture, stored in the scene: props and performers."""

from collections.abc import Sequence
from pathlib import Path

import bpy

from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import CharacterError, PerfanimError, SettingsError, SubjectError
from ...core.markers.prop import Prop, check_distinct
from ...core.markers.subject import Subject
from ...core.system.assets import PROPS
from ..character.prop_mesh import add_prop_object
from ..character.retarget_plans import map_problem
from ..preferences.paths import absolute
from ..preferences.property_kinds import choice, collection, file_path, pointer
from . import readiness
from .capture_settings import armature_pointer

SHIPPED = str(PROPS / "sword.toml")  # default definition
SIMULATED_HEIGHT_M = 1.75

_KINDS = (
    ("PROP", "Prop", "Rigid object with its own markers, such as a sword, a stick or a camera"),
    ("PERFORMER", "Performer", "Another performer with another character"),
    ("CHARACTER", "Character", "Another character that the first performer moves, too"),
)


class PERFANIM_PG_target(bpy.types.PropertyGroup):
    """A prop with its object, a further performer with a character, or a further character."""

    kind: choice("Kind", "Kind of target", _KINDS)
    definition: file_path("Definition", "Measured prop (TOML); empty for the simulated performer's sword")
    object: pointer(
        "Object",
        "Object that follows the prop, upright along its Z axis; empty adds a simple one",
        bpy.types.Object,
        poll=lambda _self, candidate: candidate.type != "ARMATURE",
    )
    subject: file_path("Subject", "Calibrated performer (TOML); empty for another simulated performer")
    armature: armature_pointer("Armature that follows the performer; empty adds a new character for another performer")


class PERFANIM_PG_targets(bpy.types.PropertyGroup):
    """List of further targets."""

    attached_to = (bpy.types.Scene, "perfanim_targets")
    entries: collection("Additional Targets", "Props and performers besides the first", PERFANIM_PG_target)
    active: bpy.props.IntProperty(name="Target", description="Target shown below the list")


def of_kind(scene: bpy.types.Scene, kind: str) -> list[PERFANIM_PG_target]:
    """Return a scene's targets of one kind, in their order."""
    return [entry for entry in scene.perfanim_targets.entries if entry.kind == kind]


def path_of(entry: PERFANIM_PG_target) -> str:
    """Return the file of a target's definition."""
    return absolute(entry.definition) or SHIPPED


def prop_of(entry: PERFANIM_PG_target) -> Prop:
    """Return a target's prop; PerfanimError if its definition is invalid."""
    return readiness.prop(path_of(entry))


def subject_of(entry: PERFANIM_PG_target) -> Subject:
    """Return a further performer with all markers calibrated; PerfanimError if there is none or its file is damaged."""
    if entry.subject:
        return readiness.subject(absolute(entry.subject))
    scene, chosen = entry.id_data, entry.id_data.perfanim
    number = of_kind(scene, "PERFORMER").index(entry) + 2
    if not readiness.is_known(chosen):
        advice = "choose its subject under Additional Targets"
        raise SubjectError("has no subject", where=f"Performer {number}", advice=advice)
    return Subject(f"Performer {number}", default_skeleton(SIMULATED_HEIGHT_M), readiness.marker_set(chosen))


def title(entry: PERFANIM_PG_target) -> str:
    """Return the title of a target in the list."""
    if entry.kind == "CHARACTER":
        return "Character"
    if entry.kind == "PERFORMER":
        subject = readiness.found(subject_of, entry)
        return subject.name if subject is not None else Path(entry.subject).stem or "Performer"
    prop = readiness.found(prop_of, entry)
    return prop.name if prop is not None else Path(path_of(entry)).stem


def problem(scene: bpy.types.Scene) -> str:
    """Return the first problem of the targets, or ""; fast enough for drawing."""
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
    if target.library is not None:
        reason, advice = "is linked from another file", "make a library override of it"
    elif target.parent is not None:
        reason, advice = "is moved by its parent", "clear the parent (Alt P), or choose the parent"
    else:
        return
    raise CharacterError(f"{reason} and cannot follow a prop", where=target.name, advice=advice)


def props(scene: bpy.types.Scene) -> list[Prop]:
    """Return the props among a scene's targets; PerfanimError if a definition is invalid, or nothing wears markers."""
    found = [prop_of(entry) for entry in of_kind(scene, "PROP")]
    if found and readiness.follows_person(scene.perfanim):
        raise SettingsError("props are found by their markers", advice="remove the props, or follow markers")
    return found


def performers(scene: bpy.types.Scene) -> list[Subject]:
    """Return the further performers among a scene's targets.

    Raises:
        PerfanimError: A performer is not calibrated, a character cannot be driven, or there is only one camera.
    """
    found = [subject_of(entry) for entry in of_kind(scene, "PERFORMER")]
    _check_characters(scene)
    if found and readiness.follows_person(scene.perfanim):
        advice = "remove the additional performers, or follow markers"
        raise SettingsError("without markers only one person is followed", advice=advice)
    if found and (readiness.is_one_camera(scene.perfanim) or not readiness.has_cameras(scene.perfanim)):
        what = "one camera cannot" if readiness.has_cameras(scene.perfanim) else "trackers cannot"
        raise SettingsError(f"{what} tell several performers apart", advice="use two cameras")
    return found


def _check_characters(scene: bpy.types.Scene) -> None:
    driven = {scene.perfanim.armature} - {None}
    for entry in scene.perfanim_targets.entries:
        if entry.kind == "PROP":
            continue
        if entry.armature is None and entry.kind == "CHARACTER":
            raise CharacterError(
                "a further character is not chosen", advice="choose its armature, or remove the target"
            )
        if entry.armature in driven:
            advice = "choose another under Additional Targets, or none for a new character"
            raise CharacterError("cannot follow two performers", where=entry.armature.name, advice=advice)
        if entry.armature is not None:
            driven.add(entry.armature)
            reason = map_problem(entry.armature)
            if reason:
                raise CharacterError(reason, where=entry.armature.name)


def object_of(context: bpy.types.Context, prop: Prop) -> str:
    """Return the name of the object that follows a prop; if none is chosen, add one."""
    found = ((entry, readiness.found(prop_of, entry)) for entry in of_kind(context.scene, "PROP"))
    entry = next((entry for entry, own in found if own is not None and own.name == prop.name), None)
    if entry is not None and entry.object is not None:
        return str(entry.object.name)
    made = add_prop_object(context, prop)
    if entry is not None:
        entry.object = made
    return str(made.name)


def meant_for(scene: bpy.types.Scene, names: Sequence[str]) -> list[int | None]:
    """Return the target index of each performer: performers are matched by name, the remaining ones in order."""
    entries = scene.perfanim_targets.entries
    free = [index for index, entry in enumerate(entries) if entry.kind == "PERFORMER"]
    meant: list[int | None] = []
    for name in names:
        found = next((index for index in free if title(entries[index]) == name), None)
        meant.append(found)
        free = [index for index in free if index != found]
    return [free.pop(0) if found is None and free else found for found in meant]
