"""Random values for Blender's properties."""

import random
from collections.abc import Sequence
from typing import Any

import bpy

_TEXTS = ("", "walk", "Hips", "//beside.toml", "/nowhere/at/all.toml", "x" * 300, "Anna / Änna", "..", "*", "%s{}")
_SOME = 0.4  # share of an operator's properties that are set


def set_one(chance: random.Random, owner: Any, paths: Sequence[str]) -> str:
    """Set one property of a group to a random value; return both."""
    properties = [each for each in owner.bl_rna.properties if _can_be_set(each)]
    if not properties:
        return "nothing"
    chosen = chance.choice(properties)
    value = value_for(chance, chosen, paths)
    try:
        setattr(owner, chosen.identifier, value)
    except (TypeError, ValueError) as error:  # a choice that depends on the scene, or an object that it does not accept
        return f"{chosen.identifier}: {error}"
    return f"{chosen.identifier} = {value!r}"


def arguments_for(chance: random.Random, operator: Any, paths: Sequence[str]) -> dict[str, Any]:
    """Return random arguments for some of an operator's properties."""
    properties = [each for each in operator.get_rna_type().properties if _can_be_set(each)]
    found = {each.identifier: value_for(chance, each, paths) for each in properties if chance.random() < _SOME}
    for name in ("path", "filepath"):  # the other properties have no effect without these
        if any(each.identifier == name for each in properties):
            found[name] = chance.choice(paths) if chance.random() < 0.9 else chance.choice(_TEXTS)
    return {name: value for name, value in found.items() if value is not None}


def _can_be_set(each: Any) -> bool:
    # bl_idname and similar names are Blender's own
    return not each.is_readonly and not each.identifier.startswith(("rna_", "bl_")) and each.type != "COLLECTION"


def value_for(chance: random.Random, each: Any, paths: Sequence[str]) -> Any:
    """Return a random value for a property's type."""
    if each.type == "POINTER":
        return chance.choice([None, *bpy.data.objects, *bpy.data.actions, *bpy.data.collections])
    if each.type == "ENUM":
        names = [item.identifier for item in each.enum_items]
        if each.is_enum_flag:
            return {name for name in names if chance.random() < 0.5}
        return chance.choice(names) if names else None
    if each.type == "STRING":
        return chance.choice(_TEXTS if chance.random() < 0.5 else tuple(paths))
    if each.is_array:
        return [_number(chance, each) for _ in range(each.array_length)]
    return _number(chance, each)


def _number(chance: random.Random, each: Any) -> Any:
    if each.type == "BOOLEAN":
        return chance.random() < 0.5
    low, high = (each.hard_min, each.hard_max) if chance.random() < 0.1 else (each.soft_min, each.soft_max)
    value = chance.choice((low, high, each.default, low + (high - low) * chance.random()))
    return int(value) if each.type == "INT" else value
