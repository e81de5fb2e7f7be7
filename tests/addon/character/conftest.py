"""Hero, a character with the names of another product, in a scene of its own."""

from pathlib import Path
from typing import Any

import bpy
import pytest
from heroes import open_hero


@pytest.fixture
def hero(request: pytest.FixtureRequest, mixamo_blend: Path) -> Any:
    if "addon" in request.fixturenames:
        request.getfixturevalue("addon")  # first, as it empties the scene
    return open_hero(mixamo_blend)


@pytest.fixture
def chosen(addon: object, hero: Any) -> Any:
    """The add-on's settings of that scene, with Hero chosen."""
    bpy.context.scene.perfanim.armature = hero
    return bpy.context.scene.perfanim
