"""The newest Blender is chosen from the build server's list, whatever its order."""

import io
import zipfile
from pathlib import Path

import pytest
from newest_blender import newest_build, unpack_wheel


def build(version: str, mtime: int, platform: str = "linux", extension: str = "zip") -> dict[str, object]:
    kept = {"platform": platform, "architecture": "x86_64", "file_extension": extension}
    return {**kept, "version": version, "file_mtime": mtime, "url": f"https://example.org/{version}-{mtime}"}


def test_the_highest_version_and_its_newest_build_is_taken() -> None:
    builds = [build("5.9.2", 30), build("5.10.0", 10), build("5.10.0", 20), build("6.0.0", 40, platform="windows")]
    builds.append(build("5.10.0", 50, extension="sha256"))
    assert newest_build(builds)["url"] == "https://example.org/5.10.0-20"
    with pytest.raises(ValueError, match="lists no build for linux x86_64"):
        newest_build(builds[3:])


def test_the_wheel_is_taken_out_of_its_archive(tmp_path: Path) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("bpy/bpy-5.3.0a0-cp313-cp313-manylinux_2_28_x86_64.whl", b"wheel")
        archive.writestr("bpy/readme.txt", b"text")
    path = unpack_wheel(packed.getvalue(), tmp_path)
    assert (path.parent, path.read_bytes()) == (tmp_path, b"wheel")
    assert path.name.startswith("bpy-5.3.0a0-cp313")
