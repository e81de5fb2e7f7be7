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
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert len(manifest["tagline"]) <= 64
    assert not manifest["tagline"].endswith(".")
    assert "Blender" not in manifest["name"]
    for permission, reason in manifest["permissions"].items():
        assert permission in ("files", "camera", "network")
        assert 10 < len(reason) <= 64
        assert not reason.endswith(".")
    assert archive.filename is not None
    assert archive.filename.endswith(f"perfanim-{__version__}-py311-windows-x64.zip")


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
    names = zipfile.ZipFile(builder.build("3.11", "windows-x64", [], tmp_path / "dist")).namelist()
    assert [name for name in names if "kernel" in name] == ["core/kernel/libraries/perfanim_kernel-windows-x64.dll"]


def test_the_diagnostics_tell_of_each_wheel(builder: ModuleType) -> None:
    wheels = {requirement.partition("==")[0] for requirement in builder.REQUIREMENTS}
    assert set(LIBRARIES.values()) == {*wheels, "numpy"}  # Blender has numpy


SCIPY_PLATFORMS = {
    "linux-x64": "manylinux_2_17_x86_64.manylinux2014_x86_64",
    "windows-x64": "win_amd64",
    "macos-arm64": "macosx_12_0_arm64",
    "macos-x64": "macosx_10_13_x86_64",
}
OPENCV_PLATFORMS = {**SCIPY_PLATFORMS, "macos-arm64": "macosx_13_0_arm64", "macos-x64": "macosx_13_0_x86_64"}
VERSIONS = {"3.11": ("4.2.0", "5.1.0"), "3.13": ("5.1.0", None)}
ARCHIVES = [(python, platform) for python in VERSIONS for platform in SCIPY_PLATFORMS]


def wheel_names(python: str, platform: str) -> list[str]:
    """Names of the wheels as the package index has them."""
    tag = f"cp{python.replace('.', '')}"
    return [
        f"scipy-1.15.3-{tag}-{tag}-{SCIPY_PLATFORMS[platform]}.whl",
        f"opencv_contrib_python_headless-4.11.0.86-cp37-abi3-{OPENCV_PLATFORMS[platform]}.whl",
        "python_osc-1.10.2-py3-none-any.whl",
        "tomli_w-1.2.0-py3-none-any.whl",
    ]


def test_there_is_an_archive_for_each_python_and_platform(builder: ModuleType) -> None:
    assert [(python, platform) for python in builder.BLENDERS for platform in builder.PLATFORMS] == ARCHIVES
    assert len(builder.REQUIREMENTS) == 4
    assert all("==" in requirement and "numpy" not in requirement for requirement in builder.REQUIREMENTS)


@pytest.mark.parametrize(("python", "platform"), ARCHIVES)
def test_each_archive_is_for_one_platform_and_the_blenders_with_its_python(
    builder: ModuleType, python: str, platform: str
) -> None:
    wheels = [Path(name) for name in wheel_names(python, platform)]
    text = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = tomllib.loads(builder.manifest_text(text, builder.BLENDERS[python], platform, wheels))
    assert manifest["platforms"] == [platform]
    assert manifest["wheels"] == [f"./wheels/{wheel.name}" for wheel in wheels]
    assert (manifest["blender_version_min"], manifest.get("blender_version_max")) == VERSIONS[python]


@pytest.mark.parametrize(("python", "platform"), ARCHIVES)
def test_only_wheels_of_that_python_and_platform_fit(builder: ModuleType, python: str, platform: str) -> None:
    for other_python, other_platform in ARCHIVES:
        scipy, opencv, *pure = wheel_names(other_python, other_platform)
        assert all(builder.fits(wheel, python, platform) for wheel in pure)
        assert builder.fits(opencv, python, platform) == (other_platform == platform)
        assert builder.fits(scipy, python, platform) == ((other_python, other_platform) == (python, platform))
    assert not builder.fits("python_osc-1.10.2-py2-none-any.whl", python, platform)
    assert not builder.fits(f"scipy-1.15.3-cp313-cp313t-{SCIPY_PLATFORMS[platform]}.whl", "3.13", platform)


def test_a_wheel_of_another_python_is_refused(builder: ModuleType, tmp_path: Path) -> None:
    wheel = tmp_path / wheel_names("3.11", "linux-x64")[0]
    wheel.write_bytes(b"wheel")
    with pytest.raises(ValueError, match=r"is not for Python 3\.13 on linux-x64"):
        builder.build("3.13", "linux-x64", [wheel], tmp_path)
    assert not list(tmp_path.glob("*.zip"))


def test_an_archive_for_the_python_of_a_distribution_asks_for_no_later_blender(
    builder: ModuleType, tmp_path: Path
) -> None:
    path = builder.build("3.13", "linux-x64", [], tmp_path, system_python=True)
    with zipfile.ZipFile(path) as archive:
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert path.name.endswith("-py313-linux-x64-system.zip")
    assert manifest["blender_version_min"] == "4.2.0"
    assert "blender_version_max" not in manifest
