"""F1 on a button or a setting opens its page of the manual, and the page has the place."""

import re
from pathlib import Path
from typing import Any

import bpy
import pytest
from bl_operators.wm import WM_OT_doc_view_manual
from manual_pages import manual_files


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return {name: data.decode() for name, data in manual_files() if name.endswith(".html")}


@pytest.fixture
def manual(part: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The manual as of an installed archive; the working tree has none."""
    module = part("preferences.manual")
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    return module


def address(name: str) -> str:
    return str(WM_OT_doc_view_manual._lookup_rna_url(name, verbose=False))


def test_every_operator_and_setting_has_a_page(manual: Any, pages: dict[str, str]) -> None:
    names = [f"bpy.ops.perfanim.{name}" for name in dir(bpy.ops.perfanim)]
    group = bpy.context.scene.perfanim.bl_rna
    names += [f"bpy.types.{group.identifier}.{prop.identifier}" for prop in group.properties]
    assert len(names) > 100
    for name in names:
        page, _, place = address(name).removeprefix(manual.manual_map()[0]).partition("#")
        assert page in pages, name
        assert not place or f'id="{place}"' in pages[page], f"{name}: {place}"


def test_every_place_of_the_map_exists(part: Any, pages: dict[str, str]) -> None:
    for pattern, target in part("preferences.manual").PAGES:
        page, _, place = target.partition("#")
        assert page in pages, pattern
        assert not place or f'id="{place}"' in pages[page], f"{pattern}: {target}"


def test_some_buttons_open_the_right_page(manual: Any) -> None:
    assert address("bpy.ops.perfanim.set_floor").endswith("capture-in-blender.html#cameras")
    assert address("bpy.ops.perfanim.solve_take").endswith("#takes-and-batches")
    assert address("bpy.ops.perfanim.bake_sketch").endswith("sketch-in-blender.html")
    assert "perfanim" not in address("bpy.ops.mesh.primitive_cube_add").replace("/", " ").split()[-1]


def test_links_and_pictures_of_the_manual_are_in_it() -> None:
    files = dict(manual_files())
    for name, data in files.items():
        for target in re.findall(r'(?:href|src)="([^"]+)"', data.decode() if name.endswith(".html") else ""):
            page, _, place = target.partition("#")
            if ":" in target:
                continue
            assert not page or page in files, f"{name}: {target}"
            if place:
                assert f'id="{place}"' in files[page or name].decode(), f"{name}: {target}"
