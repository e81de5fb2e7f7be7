"""Translations of what the sidebar says; that Blender draws them is tested where it can (tests/window)."""

import importlib
from types import ModuleType
from typing import Any

import bpy
import pytest


@pytest.fixture
def german(addon: ModuleType, extension: str) -> dict[tuple[str, str], str]:
    return importlib.import_module(f"{extension}.perfanim_addon.preferences.preferences.translations").tables()["de_DE"]


def ours(kind: Any) -> list[Any]:
    found = [cls for base in kind.__subclasses__() for cls in (base, *base.__subclasses__())]
    return [cls for cls in found if cls.__name__.startswith("PERFANIM_") and getattr(cls, "is_registered", False)]


def test_every_translated_text_is_one_that_is_drawn(german: dict[tuple[str, str], str]) -> None:
    operators = [getattr(bpy.ops.perfanim, name).get_rna_type() for name in dir(bpy.ops.perfanim)]
    drawn = {("Operator", operator.name) for operator in operators}
    drawn |= {("*", panel.bl_label) for panel in ours(bpy.types.Panel)}
    for group in ours(bpy.types.PropertyGroup):
        for prop in group.bl_rna.properties:
            drawn.add(("*", prop.name))
            drawn |= {("*", item.name) for item in getattr(prop, "enum_items_static", ())}
    assert set(german) <= drawn
    assert all(german.values())
