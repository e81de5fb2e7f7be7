"""The add-on as Blender loads it: from an extension repository, under the name bl_ext.user_default.perfanim."""

import importlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy wheel")


@pytest.fixture(scope="session")
def extension(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Name of the extension, found by Blender in a user folder made for the tests, switched off."""
    from extension_folder import use_user_folder

    return use_user_folder(tmp_path_factory.mktemp("blender"))


@pytest.fixture
def addon(extension: str) -> Iterator[object]:
    """The switched-on add-on in an empty scene."""
    import addon_utils

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    module = addon_utils.enable(extension, default_set=True)
    assert module is not None
    yield sys.modules[extension]
    addon_utils.disable(extension, default_set=True)
    # profiles, maps and takes a test has saved would be offered to the next one
    shutil.rmtree(Path(os.environ["BLENDER_USER_EXTENSIONS"]) / ".user", ignore_errors=True)


@pytest.fixture
def part(addon: object, extension: str) -> Callable[[str], Any]:
    """Return a module of the add-on by its name."""
    return lambda name: importlib.import_module(f"{extension}.perfanim_addon.{name}")


@pytest.fixture
def near_worker(part: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Jobs are done in this process."""
    from near_worker import use_near_worker

    use_near_worker(part, monkeypatch)


@pytest.fixture
def errors(addon: object, extension: str) -> Any:
    """The errors as the add-on raises them."""
    return importlib.import_module(f"{extension}.core.errors")


@pytest.fixture
def chosen(addon: object) -> Any:
    """The add-on's settings of the scene."""
    return bpy.context.scene.perfanim


@pytest.fixture
def as_recorded(addon: object) -> None:
    """Keys are the poses of the take: neither put on the floor nor laid on the scene's frames."""
    bpy.context.scene.perfanim_result.on_floor = bpy.context.scene.perfanim_result.whole_frames = False


@pytest.fixture
def targets(addon: object) -> Any:
    """The list of further targets."""
    return bpy.context.scene.perfanim_targets


@pytest.fixture
def new_character(part: Callable[[str], Any]) -> Callable[..., Any]:
    """Add a character of the product's own, by its skeleton and name."""
    create = part("character.create_character").create_character
    return lambda *given: bpy.data.objects[create(bpy.context, *given)]


@pytest.fixture(scope="session")
def starter_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The starter database, as the add-on builds it."""
    from perfanim.core.database.build_database import build_database
    from perfanim.core.system.assets import MOTION

    path = tmp_path_factory.mktemp("starter") / "starter.pfdb"
    build_database([MOTION], path)
    return path


@pytest.fixture
def new_capture(part: Callable[[str], Any], starter_file: Path) -> Callable[..., Any]:
    """Start a capture of the real worker, to be closed by the test; on request, the starter database is built first."""

    def start(is_first: bool = False) -> Any:
        operators = part("operators.database_operators")
        if not is_first:
            shutil.copy(starter_file, part("settings.readiness").starter_database_path())
        first = operators.starter_job("capture", None) if operators.is_starter_missing(bpy.context) else None
        return part("capture.live_capture").LiveCapture(None, first)

    return start


@pytest.fixture
def listed_takes(part: Callable[[str], Any]) -> Callable[[], list[Any]]:
    """Fill the list of takes, and return its entries."""

    def fill() -> list[Any]:
        part("panels.takes_panel")._fill()
        return list(bpy.context.window_manager.perfanim_takes.entries)

    return fill


@pytest.fixture(scope="module")
def made() -> str:
    """A character of the product's own, 1.68 m tall, in an empty scene."""
    from perfanim.core.body.standard_skeleton import default_skeleton
    from perfanim.perfanim_addon.character.create_character import create_character

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return create_character(bpy.context, default_skeleton(1.68))


@pytest.fixture(scope="module")
def mixamo_blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A .blend with a character, Hero, that has Mixamo's names."""
    from heroes import save_hero

    path = tmp_path_factory.mktemp("hero") / "hero.blend"
    save_hero(path)
    return path
