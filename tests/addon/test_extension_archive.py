"""The archive that a user installs: what is in it and what is not."""

import importlib.util
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest
from perfanim.core import __version__
from perfanim.core.system.libraries import LIBRARIES

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
    wheels = [folder / "tomli_w-1.2.0-py3-none-any.whl", folder / "opencv-4.11-cp37-abi3-win_amd64.whl"]
    for wheel in wheels:
        wheel.write_bytes(b"wheel")
    return zipfile.ZipFile(builder.build("windows-x64", wheels, folder))


def test_the_manifest_names_platform_and_wheels(archive: zipfile.ZipFile) -> None:
    manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert manifest["platforms"] == ["windows-x64"]
    assert [Path(wheel).name.split("-")[0] for wheel in manifest["wheels"]] == ["tomli_w", "opencv"]
    for wheel in manifest["wheels"]:
        assert wheel.removeprefix("./") in archive.namelist()
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert len(manifest["tagline"]) <= 64
    assert not manifest["tagline"].endswith(".")
    assert "Blender" not in manifest["name"]
    for permission, reason in manifest["permissions"].items():
        assert permission in ("files", "camera", "network")
        assert 10 < len(reason) <= 64
        assert not reason.endswith(".")
    assert archive.filename is not None
    assert archive.filename.endswith(f"perfanim-{__version__}-windows-x64.zip")


def test_the_addon_is_whole_and_nothing_else_is_in(archive: zipfile.ZipFile) -> None:
    names = set(archive.namelist())
    for needed in (
        "__init__.py",
        "perfanim_addon/panels/step_panels.py",
        "core/system/helper_process.py",
        "core/session/session.py",
    ):
        assert needed in names
    assert any(name.startswith("assets/motion/") for name in names)
    assert any(name.startswith("assets/marker_sets/") for name in names)
    for name in names:
        parts = name.split("/")
        assert parts[0] not in ("tests", "tools", "docs", "out", "dist", "build"), name
        assert not any(part.startswith(".") or part == "__pycache__" for part in parts), name
        assert not parts[0].endswith(".egg-info"), name
        assert "numpy" not in name


def test_the_kernel_of_the_platform_is_in(builder: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "core" / "kernel" / "libraries"
    folder.mkdir(parents=True)
    for name in ("windows-x64.dll", "windows-arm64.dll", "linux-x64.so", "macos-arm64.dylib"):
        (folder / f"perfanim_kernel-{name}").write_bytes(b"library")
    (tmp_path / "blender_manifest.toml").write_bytes((ROOT / "blender_manifest.toml").read_bytes())
    monkeypatch.setattr(builder, "ROOT", tmp_path)
    monkeypatch.setattr(builder, "KERNELS", folder)
    monkeypatch.setattr(builder, "manual_files", list)
    names = zipfile.ZipFile(builder.build("windows-x64", [], tmp_path / "dist")).namelist()
    assert [name for name in names if "kernel" in name] == ["core/kernel/libraries/perfanim_kernel-windows-x64.dll"]


def test_the_diagnostics_tell_of_each_wheel(builder: ModuleType) -> None:
    wheels = {requirement.partition("==")[0] for requirement in builder.REQUIREMENTS}
    assert set(LIBRARIES.values()) == {*wheels, "numpy"}  # Blender has numpy


PLATFORMS = {
    "linux-x64": "manylinux_2_17_x86_64.manylinux2014_x86_64",
    "windows-x64": "win_amd64",
    "macos-arm64": "macosx_13_0_arm64",
    "macos-x64": "macosx_13_0_x86_64",
}
PURE = ["python_osc-1.10.2-py3-none-any.whl", "tomli_w-1.2.0-py3-none-any.whl"]


def opencv(platform: str) -> str:
    """Name of the wheel as the package index has it."""
    return f"opencv_contrib_python_headless-4.11.0.86-cp37-abi3-{PLATFORMS[platform]}.whl"


def test_there_is_an_archive_for_each_platform(builder: ModuleType) -> None:
    assert set(builder.PLATFORMS) == set(PLATFORMS)
    assert len(builder.REQUIREMENTS) == 3
    assert all("==" in requirement and "numpy" not in requirement for requirement in builder.REQUIREMENTS)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_each_archive_is_for_one_platform_and_every_blender(builder: ModuleType, platform: str) -> None:
    wheels = [Path(name) for name in (opencv(platform), *PURE)]
    text = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = tomllib.loads(builder.manifest_text(text, platform, wheels))
    assert manifest["platforms"] == [platform]
    assert manifest["wheels"] == [f"./wheels/{wheel.name}" for wheel in wheels]
    assert manifest["blender_version_min"] == "4.2.0"
    assert "blender_version_max" not in manifest


@pytest.mark.parametrize("platform", PLATFORMS)
def test_only_wheels_of_that_platform_that_are_bound_to_no_python_fit(builder: ModuleType, platform: str) -> None:
    assert all(builder.fits(wheel, platform) for wheel in PURE)
    for other in PLATFORMS:
        assert builder.fits(opencv(other), platform) == (other == platform)
    assert not builder.fits("python_osc-1.10.2-py2-none-any.whl", platform)
    for bound in ("cp311-cp311", "cp313-cp313t", "cp312-abi3"):  # the oldest Blender has Python 3.11
        assert not builder.fits(f"scipy-1.15.3-{bound}-{PLATFORMS[platform]}.whl", platform)


def test_a_wheel_of_one_python_is_refused(builder: ModuleType, tmp_path: Path) -> None:
    wheel = tmp_path / f"scipy-1.15.3-cp311-cp311-{PLATFORMS['linux-x64']}.whl"
    wheel.write_bytes(b"wheel")
    with pytest.raises(ValueError, match="is not for every Python on linux-x64"):
        builder.build("linux-x64", [wheel], tmp_path)
    assert not list(tmp_path.glob("*.zip"))
