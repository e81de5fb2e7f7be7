"""Temporary renaming of bones for another program while a file is written."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import bpy

from ...core.errors import CharacterError
from ...core.retarget.displayed_joint_names import naming_of


@contextmanager
def exported_bone_names(armature_object: bpy.types.Object, bones: Mapping[str, str], naming: str) -> Iterator[None]:
    """Rename bones for another program, and restore their names afterwards; CharacterError for bones from another file.

    Blender renames vertex groups, animation and constraints as well. If a bone without a joint has one of the
    new names, "_" is appended to its name temporarily.
    """
    data = armature_object.data
    if data.library is not None or data.override_library is not None:
        raise CharacterError(
            "has bones linked from another file, which cannot be renamed",
            where=armature_object.name,
            advice="export them under their own names, or make the armature local",
        )
    names = naming_of(naming)
    wanted = {bone: names[joint] for joint, bone in bones.items()}
    taken = set(wanted.values())
    wanted |= {name: f"{name}_" for name in taken if name in data.bones and name not in wanted}
    _rename(data, wanted)
    try:
        yield
    finally:
        _rename(data, {name: bone for bone, name in wanted.items()})


def _rename(data: bpy.types.Armature, names: Mapping[str, str]) -> None:
    passing = {old: f"perfanim renaming {number}" for number, old in enumerate(names)}  # avoids clashes
    for old, between in passing.items():
        data.bones[old].name = between
    for old, between in passing.items():
        data.bones[between].name = names[old]
