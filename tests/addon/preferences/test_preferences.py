"""What the preferences change, and that everything explains itself."""

import os
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import pytest


@pytest.fixture
def preferences(addon: ModuleType, extension: str) -> Any:
    return bpy.context.preferences.addons[extension].preferences  # gone, with all that was set, with the add-on


def test_data_goes_where_the_user_wants_it(part: Any, preferences: Any, tmp_path: Path) -> None:
    user_folder = part("preferences.paths").user_folder
    own = {name: user_folder(name) for name in ("takes", "databases", "subjects", "calibrations", "bone_maps")}
    preferences.takes_folder = str(tmp_path / "Takes")
    preferences.databases_folder = str(tmp_path / "Motion")
    preferences.profiles_folder = str(tmp_path / "People")
    assert user_folder("takes") == tmp_path / "Takes"
    assert user_folder("databases") == tmp_path / "Motion"
    assert user_folder("subjects") == tmp_path / "People" / "subjects"
    assert user_folder("calibrations", "board") == tmp_path / "People" / "calibrations" / "board"
    assert user_folder("bone_maps").is_dir()
    assert part("take_library").new_path().parent == tmp_path / "Takes"
    preferences.takes_folder = preferences.databases_folder = preferences.profiles_folder = ""
    assert {name: user_folder(name) for name in own} == own


def test_a_folder_that_cannot_be_used_loses_nothing_and_is_told(part: Any, preferences: Any, tmp_path: Path) -> None:
    place = part("preferences.paths")
    own = place.user_folder("takes")
    (tmp_path / "file").write_text("in the way")
    assert place.folder_problem("takes") == ""
    preferences.takes_folder = str(tmp_path / "file" / "takes")
    assert place.user_folder("takes") == own
    assert "file/takes cannot be used (Not a directory)" in place.folder_problem("takes")
    preferences.profiles_folder = str(tmp_path / "file")
    assert "cannot be used" in place.folder_problem("profiles")


def test_a_relative_folder_makes_none_where_blender_was_started(
    part: Any, preferences: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = part("preferences.paths")
    own = place.user_folder("takes")
    monkeypatch.chdir(tmp_path)
    preferences.takes_folder = "Takes"
    assert place.user_folder("takes") == own
    assert "Takes cannot be used (it is not an absolute path)" in place.folder_problem("takes")
    assert list(tmp_path.iterdir()) == []


def test_new_files_begin_with_the_defaults_of_the_preferences(
    part: Any, preferences: Any, extension: str, tmp_path: Path
) -> None:
    assert bpy.context.scene.perfanim.marker_set == "boxing"
    preferences.marker_set, preferences.database = "kendo", "/motion/mine.pfdb"
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    assert bpy.context.scene.perfanim.marker_set == "kendo"
    assert bpy.context.scene.perfanim.database == "/motion/mine.pfdb"

    kept = str(tmp_path / "kept.blend")
    bpy.context.scene.perfanim.property_unset("marker_set")
    bpy.context.scene.perfanim.database = "/motion/other.pfdb"
    bpy.ops.wm.save_as_mainfile(filepath=kept)
    bpy.ops.wm.open_mainfile(filepath=kept)
    assert bpy.context.scene.perfanim.marker_set == "boxing", "files that are there stay as they are"
    assert bpy.context.scene.perfanim.database == "/motion/other.pfdb"

    preferences.marker_set = "no such set"
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    assert bpy.context.scene.perfanim.marker_set == "boxing"


def test_the_marker_sets_are_offered(part: Any) -> None:
    assert {"boxing", "kendo", "locomotion"} <= set(part("preferences.preferences")._marker_sets(None, None, ""))
    assert list(part("preferences.preferences")._marker_sets(None, None, "ken")) == ["kendo"]


def test_a_capture_is_asked_for_with_the_method_of_the_preferences(
    part: Any, preferences: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(part("settings.readiness"), "database_frames", lambda path: 1)
    make = part("capture.capture_request").make
    assert make(bpy.context.scene.perfanim).request.settings == {"method": "best"}
    preferences.method = "lwr"
    assert make(bpy.context.scene.perfanim).request.settings == {"method": "lwr"}


def test_what_a_killed_blender_has_left_is_removed_before_a_capture(
    part: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(part("settings.readiness"), "database_frames", lambda path: 1)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    make = part("capture.capture_request").make
    kept = Path(make(bpy.context.scene.perfanim).request.cameras.background_file)
    for age_s, is_kept in ((7200, True), (90_000, False)):
        kept.touch()
        os.utime(kept, (time.time() - age_s,) * 2)
        again = Path(make(bpy.context.scene.perfanim).request.cameras.background_file)
        assert again.parent == kept.parent == tmp_path and again != kept
        assert kept.exists() == is_kept


def test_motion_is_imported_by_as_many_processes_as_the_preferences_say(
    part: Any, preferences: Any, tmp_path: Path
) -> None:
    operator = part("operators.database_operators").PERFANIM_OT_build_database
    played = SimpleNamespace(files=[], directory="", filepath=str(tmp_path), mirror=False, cull=False)
    played.build_options = partial(operator.build_options, played)
    played.chosen_files = partial(operator.chosen_files, played)
    assert "--workers" not in operator.arguments(played, bpy.context)
    preferences.workers = 3
    assert operator.arguments(played, bpy.context)[-2:] == ["--workers", "3"]


SEEN_NOWHERE = ("rna_type", "name", "bl_idname")  # Blender's own


def test_everything_that_can_be_set_says_what_it_is(addon: ModuleType) -> None:
    unexplained = []
    for cls in our_classes():
        for prop in cls.bl_rna.properties:
            inherited = any(prop.identifier in base.bl_rna.properties for base in cls.__mro__ if hidden_base(base))
            if inherited or prop.identifier in SEEN_NOWHERE or prop.is_hidden:
                continue
            if len(prop.description) < 10 or prop.description == prop.name:
                unexplained.append(f"{cls.__name__}.{prop.identifier}: {prop.description!r}")
            if prop.type == "ENUM" and not prop.is_enum_flag:
                texts = [item for item in prop.enum_items_static if not item.description]
                unexplained += [f"{cls.__name__}.{prop.identifier}: {item.identifier}" for item in texts]
    assert not unexplained, "\n".join(unexplained)


def test_every_button_says_what_it_does(addon: ModuleType) -> None:
    names = dir(bpy.ops.perfanim)
    assert {"start_capture", "self_test", "copy_diagnostics"} <= set(names)
    for name in names:
        operator = getattr(bpy.ops.perfanim, name).get_rna_type()
        assert len(operator.description) > 20, name
        assert operator.name, name


def hidden_base(base: type) -> bool:
    return base.__module__ == "bpy_types" or base.__module__.startswith("_bpy")


def our_classes() -> Iterator[Any]:
    """The add-on's registered classes that carry properties."""
    for kind in (bpy.types.Operator, bpy.types.PropertyGroup, bpy.types.AddonPreferences):
        waiting = list(kind.__subclasses__())
        while waiting:
            cls = waiting.pop()
            waiting += cls.__subclasses__()
            if cls.__name__.startswith("PERFANIM_") and cls.is_registered:
                yield cls


def test_files_that_killed_processes_left_are_removed_when_the_addon_starts(
    addon: ModuleType, part: Any, preferences: Any, tmp_path: Path
) -> None:
    user_folder = part("preferences.paths").user_folder
    own = [user_folder(kind) for kind in ("takes", "databases", "subjects", "props")]
    preferences.takes_folder = str(tmp_path)
    folders = [*own, tmp_path]
    for folder in folders:
        for name in (".walk.a1b2c3d4.toml", ".walk.toml.lock", "walk.toml"):
            (folder / name).write_text("half")
            os.utime(folder / name, (0.0, 0.0))
    part("registration").unregister()
    part("registration").register()
    assert {path.name for folder in folders for path in folder.iterdir()} == {"walk.toml"}
