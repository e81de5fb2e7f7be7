"""The archive that a user installs: what is in it and what is not."""

import importlib.util
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def builder() -> ModuleType:
    spec = importlib.util.spec_from_file_location("build_extension", ROOT / "tools" / "build_extension.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def archive(builder: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("archive")
    wheels = [folder / "scipy-1.15.3-cp311-cp311-win_amd64.whl", folder / "opencv-4.11-cp37-abi3-win_amd64.whl"]
    for wheel in wheels:
        wheel.write_bytes(b"wheel")
    return zipfile.ZipFile(builder.build("3.11", "windows-x64", wheels, folder))


def test_the_manifest_names_platform_and_wheels(archive: zipfile.ZipFile) -> None:
    manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert manifest["platforms"] == ["windows-x64"]
    assert [Path(wheel).name.split("-")[0] for wheel in manifest["wheels"]] == ["scipy", "opencv"]
    for wheel in manifest["wheels"]:
        assert wheel.removeprefix("./") in archive.namelist()
    assert manifest["blender_version_min"] == "4.2.0"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert len(manifest["tagline"]) <= 64
    assert not manifest["tagline"].endswith(".")
    assert "Blender" not in manifest["name"]
    for permission, reason in manifest["permissions"].items():
        assert permission in ("files", "camera", "network")
        assert 10 < len(reason) <= 64
        assert not reason.endswith(".")
    assert archive.filename is not None
    assert archive.filename.endswith("perfanim-0.1.0-py311-windows-x64.zip")


def test_the_addon_is_whole_and_nothing_else_is_in(archive: zipfile.ZipFile) -> None:
    names = set(archive.namelist())
    for needed in ("__init__.py", "perfanim_addon/panels.py", "core/worker/bootstrap.py", "core/session.py"):
        assert needed in names
    assert any(name.startswith("assets/motion/") for name in names)
    assert any(name.startswith("assets/marker_sets/") for name in names)
    for name in names:
        parts = name.split("/")
        assert parts[0] not in ("tests", "tools", "docs", "out", "dist", "build"), name
        assert not any(part.startswith(".") or part == "__pycache__" for part in parts), name
        assert not parts[0].endswith(".egg-info"), name
        assert "numpy" not in name


def test_wheels_are_asked_for_each_platform_and_never_numpy(builder: ModuleType) -> None:
    assert set(builder.PLATFORMS) == {"linux-x64", "windows-x64", "macos-arm64", "macos-x64"}
    assert all("==" in requirement and "numpy" not in requirement for requirement in builder.REQUIREMENTS)
