"""A new character does not stand inside what is in the scene already."""

from typing import Any

import bpy
import pytest


@pytest.fixture
def stage(part: Any) -> Any:
    return part("character.free_place")


def place(stage: Any) -> list[float]:
    return list(stage.find_free_position(bpy.context))


def test_an_empty_scene_has_the_character_at_its_origin(stage: Any) -> None:
    assert place(stage) == [0.0, 0.0, 0.0]


def test_blenders_first_cube_is_stepped_aside_from_and_a_character_from_the_next(stage: Any) -> None:
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    assert place(stage) == [2.5, 0.0, 0.0]
    bpy.ops.perfanim.add_character("EXEC_DEFAULT")
    assert list(bpy.context.scene.perfanim.armature.location) == [2.5, 0.0, 0.0]
    assert place(stage) == [-2.5, 0.0, 0.0]


def test_floors_hidden_objects_and_rooms_do_not_matter(stage: Any) -> None:
    bpy.ops.mesh.primitive_plane_add(size=20.0)
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    bpy.context.object.hide_set(True)
    assert place(stage) == [0.0, 0.0, 0.0]
    bpy.ops.mesh.primitive_cube_add(size=20.0)
    assert place(stage) == [0.0, 0.0, 0.0]
